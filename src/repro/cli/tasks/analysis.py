"""task=analysis: intervals, recency, calibration, baselines, the verdicts on the paper's claims, and the page."""

from repro.cli.inputs import analysis_inputs, is_up_to_date
from repro.cli.jobs import Job


def run(job: Job) -> None:
    """Write analysis/ and report.html, unless they are up to date.

    Raises:
        ValueError: no network has been evaluated, or some runs are damaged.
    """
    page = job.outputs.path / "report.html"
    if page.is_file() and is_up_to_date(job.outputs.analysis, analysis_inputs(job.outputs)):
        print(f"Page is up to date: {page}")
        return
    from repro.cli.analysis import analyze  # imports everything, some seconds

    analyze(job)
