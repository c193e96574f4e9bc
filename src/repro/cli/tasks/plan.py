"""task=plan: what is recorded, trained, failed, evaluated and missing of the study, and how long the rest takes."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the status of an outputs directory and what is left, measuring the networks that are to be trained."""
    from repro.cli.plan import Left, plan_study
    from repro.reporting.study import describe_outputs

    print(describe_outputs(job.study, job.call.scale.pairs))
    print(f"\nLeft to do in {job.outputs.path}:", flush=True)
    for line in plan_study(job, Left.of(job)):
        print(line, flush=True)


TASK = Task(run, once=True, trains=True)
