"""task=status: what is recorded, trained, paused, failed, evaluated and missing."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the status of an outputs directory."""
    from repro.reporting.study import Study, describe_outputs

    print(describe_outputs(Study(job.outputs, job.call.world["experiments"], job.call.seed), job.call.scale.pairs))


TASK = Task(run, once=True)
