"""task=status: what is recorded, trained, paused, failed, evaluated and missing."""

from repro.cli.jobs import Job
from repro.reporting.study import Study, describe_outputs


def run(job: Job) -> None:
    """Print the status of an outputs directory."""
    print(describe_outputs(Study(job.outputs, job.call.world["experiments"], job.call.seed), job.call.scale.pairs))
