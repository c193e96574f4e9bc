"""task=analysis: intervals, recency, calibration, baselines, the verdicts on the paper's claims, and the page."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write analysis/ and report.html."""
    print(f"analyzing {job.outputs.path}: baselines first", flush=True)
    from repro.cli.outputs_analysis import analyze, evaluate_baselines  # takes seconds
    from repro.runs.parallel import process_pool

    with process_pool(job.call.runtime.workers) as parallel:
        evaluate_baselines(job.outputs, parallel)
        analyze(job.outputs, parallel)


TASK = Task(run, once=True)
