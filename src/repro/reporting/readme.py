"""Tables of README.md and other documents, generated from reproduce/results."""

import re
from pathlib import Path

import pandas as pd

from repro.config import PROJECTION
from repro.reporting.captions import caption, missing
from repro.reporting.names import TITLES
from repro.reporting.results import read_published
from repro.reporting.rows import read_rows
from repro.reporting.summaries import (
    bounds_to_markdown,
    claims_to_markdown,
    extrapolated_to_markdown,
    methods_to_markdown,
    networks_to_markdown,
)
from repro.reporting.tables import Table, costs_to_markdown, make_tables
from repro.runs.keys import CELL
from repro.system.errors import InputError

MARKS = re.compile(r"(<!-- results: ([\w-]+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

SUMMARIES = ("methods", "bounds", "networks")
INTERVAL = ("metric", "value", "low", "high")
COLUMNS = {  # what the Markdown needs of each published table
    "costs": ("model", "encoding", "size_px", "parameters_m", "training_min", "cpu_eager_ms", "cpu_onnx_ms"),
    "claims": (
        *("quote", "means", "reason", "verdict", "ours", "paper", "paper_value"),
        *("value", "low", "high", "claimed", "tolerance"),
    ),
    "extrapolated": ("experiment", "encoding", "pairs", "size_px", *INTERVAL, "target", "measured", "paper"),
    "intervals": (*CELL, *INTERVAL, "seeds"),
    "recency": (*CELL, "recency", *INTERVAL),
    "calibration": (*CELL, "method", "recency", "log_loss"),
}


def with_results(text: str, results: Path) -> str:
    """Return a document with the tables between its marks regenerated from the published results.

    A mark is `<!-- results: laptop main -->`, closed by `<!-- end -->`. Instead of `main` it may name another table
    (`ablation`, `costs`, `claims`, `methods`, `bounds`, `networks`, `curves`), or one network or `average` for its rows
    in both tables.

    Raises:
        ValueError: a mark is not closed before the next one.
    """
    begins, ends = text.count("<!-- results:"), len(MARKS.findall(text))
    if begins != ends or any("<!-- results:" in match[0][len(match[1]) :] for match in MARKS.finditer(text)):
        raise InputError("every mark <!-- results: ... --> needs its own <!-- end --> before the next mark")

    def table(match: re.Match[str]) -> str:
        return match[1] + _markdown(results / match[2], match[3]) + match[4]

    return MARKS.sub(table, text)


def _read(path: Path) -> pd.DataFrame:
    """Load a published table with the columns that its Markdown needs."""
    return read_rows(path, COLUMNS[path.stem])


def _markdown(directory: Path, name: str) -> str:
    """Return the table that a mark names, from a published directory."""
    if name == "costs":
        text = (directory / "costs.txt").read_text(encoding="utf-8").strip()
        return costs_to_markdown(Table(_read(directory / "costs.csv"), text))
    if name == "claims":
        return claims_to_markdown(_read(directory / "analysis" / "claims.csv"))
    if name == "curves":
        return extrapolated_to_markdown(_read(directory / "analysis" / "extrapolated.csv"))
    if name in SUMMARIES:
        return _summary(directory, name)
    runs = read_published(directory)
    if name in TITLES:
        return _rows_of_model(runs, name).to_markdown()
    tables = make_tables(runs)
    if name not in tables:
        known = ["costs", "claims", "curves", *SUMMARIES, *tables]
        raise InputError(f"results: {directory.name} {name}: expected {', '.join(known)}, or a network")
    return tables[name].to_markdown()


def _summary(directory: Path, name: str) -> str:
    """Return a table of methods, bounds or networks, with the scale in its caption."""
    whole = caption(read_published(directory))
    scale = whole[: whole.index(", seed")]
    intervals, recency, calibration = (
        _read(directory / "analysis" / f"{stem}.csv") for stem in ("intervals", "recency", "calibration")
    )
    if name == "methods":
        title = "Networks, other inputs, baselines and the upper bound, with 95 % intervals"
        return methods_to_markdown(intervals, f"{title}. {scale}.")
    if name == "bounds":
        title = "The upper bound with more and less knowledge, with 95 % intervals"
        return bounds_to_markdown(intervals, recency, f"{title}. {scale}.")
    title = "Networks and inputs; training on one CPU thread, latency of a window in ONNX Runtime on two"
    costs = _read(directory / "costs.csv")
    return networks_to_markdown(intervals, calibration, costs, f"{title}. {scale}.", ("3", "4"))


def _rows_of_model(runs: pd.DataFrame, model: str) -> Table:
    """Select the rows of one model, or of the average, from the main table and the ablation."""
    main, ablation = (table.frame for table in make_tables(runs).values())
    if len(ablation):
        main = pd.concat([main, ablation.assign(experiment=ablation["experiment"] + ", no decay")])
    return Table(main[main["model"] == model], caption(runs) + missing(runs, PROJECTION))
