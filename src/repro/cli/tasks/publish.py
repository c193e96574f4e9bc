"""task=publish: copy the results of an outputs directory into reproduce/results, and its tables into the docs."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Publish the results and update the generated tables."""
    from repro.cli.publishing import publish_results

    publish_results(job)


TASK = Task(run, once=True, own=("publish",))
