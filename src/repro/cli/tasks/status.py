"""task=status: what is recorded, trained, paused, failed, evaluated and missing."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the status of an outputs directory."""
    from repro.reporting.study import describe_outputs

    print(describe_outputs(job.study, job.call.scale.pairs))


TASK = Task(run, once=True)
