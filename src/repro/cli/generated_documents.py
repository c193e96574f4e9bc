"""Write verdicts and generated tables from reproduce/results."""

from pathlib import Path

from repro.cli.jobs import RESULTS, ROOT
from repro.reporting.documents import with_results
from repro.reporting.papers_claims import verdicts
from repro.reporting.results import read_frames, read_published
from repro.system.files import write_text


def update_docs() -> None:
    """Write the verdicts of the published analyses, and the tables between the markers of documents."""
    others = {name: read_frames(RESULTS / name)[name] for name in ("navigation", "scaling")}
    for path in sorted(RESULTS.glob("*/analysis/claims.csv")):
        published = path.parents[1]
        judged = verdicts({**read_frames(published), **others}, read_published(published))
        _update(path, judged.to_csv(index=False, float_format="%.6g"))
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted(RESULTS.glob("*/tables.md"))):
        _update(path, with_results(path.read_text(encoding="utf-8"), RESULTS))


def _update(path: Path, text: str) -> None:
    if text != path.read_text(encoding="utf-8"):
        write_text(path, text)
        print(f"updated {path}")


if __name__ == "__main__":
    update_docs()
