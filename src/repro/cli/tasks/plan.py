"""task=plan: what is recorded, trained, failed, evaluated and missing of the study, and how long the rest takes."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the status of an outputs directory and the time of the rest, measuring the networks to be trained."""
    from repro.cli.plan import seconds_left
    from repro.cli.study import describe_outputs
    from repro.reporting.names import duration

    print(describe_outputs(job.study, job.call.scale.pairs), flush=True)
    if seconds := seconds_left(job):
        print(f"What is missing takes about {duration(seconds)} on idle cores, at the usual number of epochs;")
        print("it can be interrupted, the same command resumes")


TASK = Task(run, once=True, trains=True)
