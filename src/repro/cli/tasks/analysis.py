"""task=analysis: intervals, recency, calibration, baselines, the verdicts on the paper's claims, and the page."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write analysis/ and report.html."""
    from repro.cli.analysis import analyze, evaluate_baselines

    evaluate_baselines(job.outputs, job.call.runtime.workers)
    analyze(job.outputs)


TASK = Task(run, once=True)
