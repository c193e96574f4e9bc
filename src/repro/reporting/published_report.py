"""The report of a published directory, made anew from its tables and figures."""

import re
from pathlib import Path

from repro.reporting.captions import caption
from repro.reporting.names import scale_options
from repro.reporting.page import Report, render
from repro.reporting.results import audits, read_origins, read_published
from repro.reporting.rows import read_rows
from repro.reporting.tables import make_tables

SAMPLES = re.compile(r'<script id="data" type="application/json">(.*?)</script>', re.DOTALL)


def render_published(directory: Path) -> str:
    """Return the report of a published directory that has one; the samples stay those of the present report.

    Raises:
        ValueError: a table or the provenance cannot be read.
    """
    results = read_published(directory)
    scale = str(results["scale"].iloc[0])
    frames = {path.stem: read_rows(path) for path in sorted((directory / "analysis").glob("*.csv"))}
    samples = SAMPLES.search((directory / "report.html").read_text(encoding="utf-8"))
    report = Report(
        scale=scale,
        outputs=directory.name,
        command=f"python run.py task=analysis {scale_options(scale, Path('outputs', directory.name))}",
        caption=caption(results),
        tables=make_tables(results),
        frames={**frames, "audit": audits(results)},
        claims=frames["claims"],
        figures={path.stem: path for folder in (directory, directory / "analysis") for path in folder.glob("*.png")},
        samples=samples[1] if samples else "",
        origins=read_origins(directory),
    )
    return render(report)
