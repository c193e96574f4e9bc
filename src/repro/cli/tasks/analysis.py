"""task=analysis: intervals, recency, calibration, baselines, the verdicts on the paper's claims, and the page."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write analysis/ and report.html, unless they are up to date.

    Raises:
        InputError: no network has been evaluated, or some runs are damaged.
    """
    from repro.cli.inputs import analysis_inputs, is_up_to_date

    page = job.outputs.path / "report.html"
    if page.is_file() and is_up_to_date(job.outputs.analysis, analysis_inputs(job.outputs)):
        print(f"Page is up to date: {page}")
        return
    from repro.cli.analysis import analyze  # imports everything, some seconds

    analyze(job)


TASK = Task(run, once=True)
