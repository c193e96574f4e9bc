"""task=inference: evaluate what scans alone tell, see `baselines.inference`, which is too slow for task=analysis."""

from repro.baselines.names import SLOW_BASELINES
from repro.cli.jobs import Job
from repro.evaluation.evaluate import evaluate_baseline


def run(job: Job) -> None:
    """Evaluate the slow baselines of an experiment, unless they are evaluated.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    for name in SLOW_BASELINES:
        evaluate_baseline(job.outputs, job.config, name)
