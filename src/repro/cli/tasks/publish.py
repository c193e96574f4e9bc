"""task=publish: copy the results of an outputs directory into reproduce/results, and its tables into the docs."""

from repro.cli.jobs import RESULTS, Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Publish the results and update the generated tables."""
    print(f"reading {job.outputs.path}", flush=True)
    from repro.cli.generated_documents import update_docs
    from repro.reporting.publication import publish

    print(f"published {publish(job.outputs, RESULTS, force=job.call.publish.force)}")
    update_docs()


TASK = Task(run, once=True, own=("publish",))
