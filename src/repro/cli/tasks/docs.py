"""task=docs: write the tables of README.md and docs/ and the published reports from reproduce/results."""

from repro.cli.jobs import RESULTS, ROOT, Job
from repro.reporting.published_report import render_published
from repro.reporting.readme import with_results
from repro.system.files import write_text


def run(job: Job) -> None:
    """Update the generated tables and reports."""
    update_docs()


def update_docs() -> None:
    """Write the tables between the markers of README.md and docs/, and the published reports, from the results."""
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted(RESULTS.glob("*/report.html"))):
        text = path.read_text(encoding="utf-8")
        new = render_published(path.parent) if path.suffix == ".html" else with_results(text, RESULTS)
        if new != text:
            write_text(path, new)
            print(f"updated {path.relative_to(ROOT)}")
