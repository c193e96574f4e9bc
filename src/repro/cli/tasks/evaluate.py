"""task=evaluate: evaluate a trained network, and the quick baselines beside it."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task
from repro.system.progress import say


def run(job: Job) -> None:
    """Evaluate a run on the test set, unless it is evaluated.

    Raises:
        InputError: the run is not trained, of another configuration, or damaged.
    """
    job.run.check_trained()
    job.run.check(job.config)
    if not job.run.is_evaluated:
        say(f"evaluating {job.run}")
    from repro.baselines.titles import QUICK_BASELINES
    from repro.cli.output import summary_line
    from repro.evaluation.scoring import evaluate, evaluate_baseline

    if job.run.is_evaluated:
        job.run.check_files()
        say(f"done already: {job.run.done}")
    else:
        row = evaluate(job.run, job.recordings, accelerator=job.call.runtime.accelerator)
        say(f"{job.run}, test: {summary_line(row)}")
    for name in QUICK_BASELINES:
        evaluate_baseline(job.outputs, job.config, name)


TASK = Task(run, "run", target=lambda job: job.run.path)
