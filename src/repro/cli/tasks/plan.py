"""task=plan: what is recorded, trained, failed, evaluated and missing of the study."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the status of an outputs directory, and the usual time of the whole study."""
    from repro.cli.study import describe_outputs

    print(describe_outputs(job.study, job.call.scale.pairs), flush=True)
    print(f"The whole study usually takes {job.call.scale.takes}; it can be interrupted, the same command resumes.")


TASK = Task(run, once=True, trains=True)
