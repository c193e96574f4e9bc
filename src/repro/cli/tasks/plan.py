"""task=plan: what is left of the study at a scale, and how long it takes on this machine."""

from repro.cli.jobs import Job
from repro.config import NETWORKS
from repro.learning.cost import plan_study
from repro.recordings.format import recordings_in
from repro.reporting.study import Study


def run(job: Job) -> None:
    """Print what is left, measuring the networks that are still to be trained."""
    print(f"Left to do in {job.outputs.path}:", flush=True)
    existing = [recordings_in(job.outputs.recordings(experiment), job.pairs) for experiment in job.experiments]
    recordings = sum(job.pairs.values()) * len(existing) - sum(existing)
    runs = Study(job.outputs, job.experiments, job.seed).runs()
    trainings = {name: sum(k.model == name and not run.is_trained for k, run in runs.items()) for name in NETWORKS}
    evaluations = sum(not run.is_evaluated for run in runs.values())
    for line in plan_study(job.scale, job.runtime.precision, recordings, trainings, evaluations):
        print(line, flush=True)
