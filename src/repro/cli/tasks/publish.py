"""task=publish: copy the results of an outputs directory into reproduce/results, and its tables into the docs."""

from repro.cli.jobs import RESULTS, Job
from repro.cli.tasks.docs import update_docs
from repro.reporting.additions import add_to_published
from repro.reporting.publish import publish


def run(job: Job) -> None:
    """Publish the results and update the generated tables."""
    if job.add:
        target = add_to_published(job.outputs, RESULTS, job.scale.name)
    else:
        target = publish(job.outputs, RESULTS, job.scale.name, force=job.force)
    print(f"published {target}")
    update_docs()
