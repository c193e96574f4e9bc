"""task=plan: what is left of the study at a scale, and how long it takes on this machine."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print what is left, measuring the networks that are still to be trained."""
    from repro.cli.plan import print_plan

    print_plan(job)


TASK = Task(run, once=True, needs_batches=True)
