"""task=train: train one network."""

from functools import cache
from typing import Any

from repro.cli.jobs import Job
from repro.cli.tasks import Task
from repro.recordings.reader import open_recordings
from repro.system.progress import say


def run(job: Job) -> None:
    """Train the network of a run from where it was left, unless it is trained."""
    job.outputs.check_data(job.config)
    if not job.run.is_trained:
        open_recordings(job.recordings)  # which refuses before the run begins, and PyTorch is loaded
    job.run.prepare(job.config)
    if not job.run.is_trained:
        say(f"training {job.run}, after PyTorch is loaded")
    from repro.learning.training import train  # takes seconds
    from repro.runs.parallel import use_idle_cores
    from repro.runs.provenance import Status

    use_idle_cores()
    runtime = job.call.runtime
    status = train(
        job.run,
        job.recordings,
        accelerator=runtime.accelerator,
        precision=runtime.precision,
        budget=process_budget(runtime.max_minutes),
    )
    if status is Status.paused:
        say(f"paused {job.run}: the time limit is reached, the same command resumes")


@cache
def process_budget(minutes: float | None) -> Any:
    """Return the time budget that all jobs of this process share."""
    from repro.learning.callbacks import Budget

    return Budget(minutes)


TASK = Task(run, "run", trains=True, target=lambda job: job.run.path)
