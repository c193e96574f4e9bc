"""task=all: record what is missing, train, evaluate."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task, evaluate, record, train
from repro.system.progress import say


def run(job: Job) -> None:
    """Run the three tasks, unless the run and its baselines are evaluated already."""
    from repro.baselines.titles import QUICK_BASELINES

    baselines = [job.config.of_baseline(name) for name in QUICK_BASELINES]
    runs = [job.run, *(job.outputs.run(baseline.key) for baseline in baselines)]
    if all(run.is_evaluated for run in runs):
        job.run.prepare(job.config)
        job.run.check_files()
        say(f"done already: {job.run.done}")
        return
    if not job.run.is_evaluated:
        job.run.check(job.config)
        job.outputs.check_data(job.config)
        record.run(job)
    train.run(job)
    if job.run.is_trained:
        evaluate.run(job)


TASK = Task(run, "run", trains=True, target=lambda job: job.run.path)
