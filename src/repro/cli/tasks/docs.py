"""task=docs: write the tables of README.md and docs/ and the published reports from reproduce/results."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Update the generated tables and reports."""
    from repro.cli.documents import update_docs

    update_docs()


TASK = Task(run, once=True, names_scale=False)
