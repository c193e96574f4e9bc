"""task=analysis: intervals, recency, calibration, baselines, the verdicts on the paper's claims, and the page."""

from repro.cli.jobs import ROOT, Job
from repro.reporting.uptodate import inputs_hash, is_up_to_date
from repro.runs.directories import Outputs

CLAIMS = ROOT / "reproduce" / "claims.yaml"


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


def analysis_inputs(outputs: Outputs) -> str:
    """Return a hash of everything that the analysis depends on."""
    others = [*outputs.curves.glob("*.csv"), outputs.analysis / "generalization.csv", CLAIMS]
    return inputs_hash(outputs, [*others, *sorted(outputs.figures.glob("*.png"))])
