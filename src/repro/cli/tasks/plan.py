"""task=plan: what is recorded, trained, failed, evaluated and missing of the study."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the status of an outputs directory, and the usual time of the whole study."""
    from repro.cli.study_plan import StudyPlan, describe_outputs
    from repro.recordings.format import spec_fingerprint

    worlds = {name: spec_fingerprint(spec) for name, spec in job.call.specs.items()}
    study = StudyPlan(job.outputs, job.call.specs, job.call.seed, worlds)
    print(describe_outputs(study, job.call.scale.pairs), flush=True)
    print(f"It usually takes {job.call.scale.takes}; it can be interrupted, the same command resumes.")


TASK = Task(run, once=True, trains=True)
