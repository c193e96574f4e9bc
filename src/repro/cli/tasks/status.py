"""task=status: what is recorded, trained, paused, failed, evaluated and missing."""

from repro.cli.jobs import Job
from repro.reporting.status import describe_outputs
from repro.reporting.study import Study


def run(job: Job) -> None:
    """Print the status of an outputs directory."""
    print(describe_outputs(Study(job.outputs, job.call.world["experiments"], job.call.seed), job.call.scale.pairs))
