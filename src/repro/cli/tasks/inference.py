"""task=inference: evaluate what scans alone tell, see `baselines.inference`, which is too slow for task=analysis."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Evaluate the slow baselines of an experiment, unless they are evaluated.

    Raises:
        InputError: the worlds have other laws than the paper's.
    """
    from repro.baselines.names import SLOW_BASELINES
    from repro.evaluation.evaluate import evaluate_baseline

    for name in SLOW_BASELINES:
        evaluate_baseline(job.outputs, job.config, name)


TASK = Task(run)
