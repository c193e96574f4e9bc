"""task=docs: write the tables of README.md and docs/ from reproduce/results."""

from repro.cli.jobs import RESULTS, ROOT, Job
from repro.reporting.readme import with_results
from repro.system.files import write_text


def run(job: Job) -> None:
    """Update the generated tables."""
    update_docs()


def update_docs() -> None:
    """Write the tables between the markers of README.md and docs/ from the published results."""
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        text = path.read_text(encoding="utf-8")
        new = with_results(text, RESULTS)
        if new != text:
            write_text(path, new)
            print(f"updated {path.relative_to(ROOT)}")
