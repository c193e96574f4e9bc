"""What trainings at paper scale cost on a machine without a GPU, measured before they start."""

import sys

from repro.cli.jobs import Job
from repro.learning.cost import training_seconds, trainings_at_once
from repro.reporting.names import duration


def print_cost(jobs: list[Job]) -> None:
    """Print the estimated duration of the trainings that are left, and how to ask for less."""
    left = [job for job in jobs if not job.run.is_trained]
    if not left:
        return
    print("measuring what paper scale costs on this machine", flush=True)
    kinds = {_kind(job): job for job in left}
    runtime = left[0].call.runtime
    each = {kind: training_seconds(job.config, runtime.precision, runtime.accelerator) for kind, job in kinds.items()}
    at_once = min(len(left), trainings_at_once(left[0].config, runtime.accelerator))
    total = sum(each[_kind(job)] for job in left) / at_once
    trainings = "this training takes" if len(left) == 1 else f"these {len(left)} trainings take"
    print(
        f"warning: no CUDA GPU is visible: {trainings} about {duration(total)}. For less, use scale=laptop.",
        file=sys.stderr,
        flush=True,
    )


def _kind(job: Job) -> str:
    """Return what the duration of a training depends on, as text: everything but its worlds and its seed."""
    return str((job.config.model, job.config.encoding, job.config.train, job.call.scale))
