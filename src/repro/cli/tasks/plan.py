"""task=plan: what is left of the study at a scale, and how long it takes on this machine."""

from repro.cli.jobs import Job
from repro.cli.limits import recording_seconds
from repro.config import NETWORKS
from repro.learning.cost import plan_study
from repro.recordings.format import recordings_in
from repro.reporting.study import Study
from repro.system.resources import count_cores


def run(job: Job) -> None:
    """Print what is left, measuring the networks that are still to be trained."""
    print(f"Left to do in {job.outputs.path}:", flush=True)
    missing = {
        name: sum(job.pairs.values()) - recordings_in(job.outputs.recordings(name), job.pairs)
        for name in job.experiments
    }
    seconds = sum(recording_seconds(job.spec | job.experiments[name], count) for name, count in missing.items())
    seconds /= min(job.runtime.workers, count_cores())
    runs = Study(job.outputs, job.experiments, job.seed).runs()
    trainings = {name: sum(k.model == name and not run.is_trained for k, run in runs.items()) for name in NETWORKS}
    evaluations = sum(not run.is_evaluated for run in runs.values())
    recordings, precision = sum(missing.values()), job.runtime.precision
    for line in plan_study(job.config, precision, recordings, seconds, trainings, evaluations):
        print(line, flush=True)
