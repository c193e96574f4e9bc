"""What trainings at paper scale cost on a machine without a GPU, measured before they start."""

import sys

from repro.cli.jobs import Job
from repro.learning.cost import readable, training_seconds, trainings_at_once


def print_cost(jobs: list[Job]) -> None:
    """Print the estimated duration of the trainings that are left, and how to ask for less."""
    left = [job for job in jobs if not job.run.is_trained]
    if not left:
        return
    print("measuring what paper scale costs on this machine", flush=True)
    models = {job.config.model: 0.0 for job in left}
    seconds = {model: training_seconds(model, left[0].scale, left[0].runtime.precision) for model in models}
    total = sum(seconds[job.config.model] for job in left) / min(len(left), trainings_at_once(left[0].scale))
    trainings = "this training takes" if len(left) == 1 else f"these {len(left)} trainings take"
    print(
        f"warning: no CUDA GPU is visible: {trainings} about {readable(total)}. For less, use scale=laptop.",
        file=sys.stderr,
        flush=True,
    )
