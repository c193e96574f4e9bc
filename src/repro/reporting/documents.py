"""Tables of the documents: Markdown from reproduce/results, between the marks of a document."""

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from repro.config import PROJECTION
from repro.reporting import analysis_tables
from repro.reporting.names import TITLES
from repro.reporting.navigation import arms_table, density_table
from repro.reporting.plots import DataFrames
from repro.reporting.render import Cells
from repro.reporting.results import read_frames, read_published
from repro.reporting.tables import Table, caption, make_tables, missing
from repro.system.errors import InputError

MARKS = re.compile(r"(<!-- results: ([\w-]+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
ANALYZED: dict[str, tuple[Callable[[DataFrames, str], Cells], str]] = {  # tables of the analysis with their titles
    "methods": (
        analysis_tables.methods,
        "Networks, other inputs, baselines and the upper bound, with 95 % intervals",
    ),
    "bounds": (analysis_tables.bounds, "The upper bound with more and less knowledge, with 95 % intervals"),
    "networks": (
        analysis_tables.networks,
        "Networks and inputs; training on one CPU thread, latency of a window in ONNX Runtime on two",
    ),
    "arms": (
        arms_table,
        "Share of the courses in which the robot reaches both goals, with 95 % intervals; mean time of the successes",
    ),
    "density": (density_table, "The same share by the number of obstacles, in all worlds together"),
}


def with_results(text: str, results: Path) -> str:
    """Return a document with the tables between its marks regenerated from the published results.

    A mark is `<!-- results: laptop main -->`, closed by `<!-- end -->`. Instead of `main` it may name another table
    (`ablation`, `costs`, `claims`, `methods`, `bounds`, `networks`, `arms`, `density`), or one network or `average` for
    its rows in both tables.

    Raises:
        ValueError: a mark is not closed before the next one.
    """
    begins, ends = text.count("<!-- results:"), len(MARKS.findall(text))
    if begins != ends or any("<!-- results:" in match[0][len(match[1]) :] for match in MARKS.finditer(text)):
        raise InputError("every mark <!-- results: ... --> needs its own <!-- end --> before the next mark")

    def table(match: re.Match[str]) -> str:
        return match[1] + _markdown(results / match[2], match[3]) + match[4]

    return MARKS.sub(table, text)


def _markdown(directory: Path, name: str) -> str:
    """Return the table that a mark names, from a published directory."""
    if name in (*ANALYZED, "claims", "costs"):
        try:
            return _analyzed(directory, name)
        except KeyError as error:
            raise InputError(f"{directory}: {name} needs the table or column {error}: restore the CSV files") from error
    runs = read_published(directory)
    tables = make_tables(runs)
    if name in TITLES:
        return _rows_of_model(runs, tables, name).to_markdown()
    if name not in tables:
        known = ", ".join([*ANALYZED, "claims", "costs", *tables])
        raise InputError(f"results: {directory.name} {name}: expected {known}, or a network")
    return tables[name].to_markdown()


def _analyzed(directory: Path, name: str) -> str:
    frames = read_frames(directory)
    if name == "claims":
        return analysis_tables.claims(frames)
    if name == "costs":
        measured, note = frames["costs"], (directory / "costs.txt").read_text(encoding="utf-8").strip()
        return analysis_tables.costs(measured, note).to_markdown()
    make, title = ANALYZED[name]
    facts = caption(read_published(directory)) if (directory / "runs.csv").is_file() else ""  # of its trainings
    return make(frames, f"{title}." + f" {facts[: facts.index(', seed')]}." * bool(facts)).to_markdown()


def _rows_of_model(runs: pd.DataFrame, tables: dict[str, Table], model: str) -> Table:
    """Select the rows of one model, or of the average, from the main table and the ablation."""
    rows, ablation = tables["main"].frame, tables["ablation"].frame
    if len(ablation):
        rows = pd.concat([rows, ablation.assign(experiment=ablation["experiment"] + ", no decay")])
    return Table(rows[rows["model"] == model], caption(runs) + missing(runs, PROJECTION))
