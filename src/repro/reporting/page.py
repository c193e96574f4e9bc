"""The HTML report: one self-contained file with tables, claims, figures and provenance."""

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from repro.baselines.names import rank
from repro.config import PROJECTION
from repro.networks.model import NETWORKS
from repro.reporting.claims import on_paper
from repro.reporting.names import machine_title, short_commit
from repro.reporting.plots import DataFrames
from repro.reporting.render import Cells, cells_of, interval, with_interval
from repro.reporting.results import read_frames, read_origins, read_published
from repro.reporting.tables import HEADS, caption, make_tables, row_title
from repro.runs.keys import CELL
from repro.runs.provenance import Provenance

PX_PER_INCH = 110  # of the images on the page, so that their text has the size of its text
CALIBRATION = {
    "brier": ("Brier", 4),
    "reliability": ("reliability", 4),
    "resolution": ("resolution", 4),
    "log_loss": ("log-loss", 4),
    "calibration_error": ("calibration error", 4),
    "uncertain_error": ("where uncertain", 4),
}
COST = {
    "channels": ("channels", 0),
    "parameters": ("parameters", 0),
    "training_seconds": ("training [s]", 0),
    "peak_memory_gb": ("memory [GB]", 1),
}
DIFFERENCE = {"value": ("difference", 4), "low": ("low", 4), "high": ("high", 4)}


@dataclass(frozen=True)
class Report:
    """The content of the HTML report of an outputs directory.

    Args:
        outputs: path of the outputs directory.
        results: tidy rows of its runs, see `results.read_results`.
        frames: the frames of `evaluation.analysis.gather`, and `claims`.
        figures: PNG and GIF files by name.
        origins: provenance of each run by its path.
    """

    outputs: Path
    results: pd.DataFrame
    frames: DataFrames
    figures: dict[str, Path]
    origins: dict[str, Provenance]


def render(report: Report) -> str:
    """Return the report as one string of HTML; worlds that are not the paper's have no claims."""
    intervals = report.frames["intervals"]
    of_cells = intervals.set_index([*CELL, "metric"])

    def interval_of(row: dict[str, Any], metric: str) -> str:
        """Return the interval of a cell; empty for one of other seeds than those of the row."""
        key = (*(row[name] for name in CELL), metric)
        is_known = key in of_cells.index and of_cells.loc[key, "seeds"] == row["seeds"]
        return interval(*of_cells.loc[key, ["low", "high"]]) if is_known else ""

    environment = Environment(loader=PackageLoader("repro.reporting"), autoescape=True, undefined=StrictUndefined)
    functions = (interval_of, with_interval, on_paper, row_title, _embedded)
    environment.globals |= {each.__name__.lstrip("_"): each for each in functions} | {"is_known": pd.notna}
    return environment.get_template("report.html").render(
        scale=str(report.results["scale"].iloc[0]),
        outputs=report.outputs,
        caption=caption(report.results),
        all_free=_all_free(intervals),
        seeds=int(intervals["seeds"].max()),
        heads=HEADS,
        tables=[table for table in make_tables(report.results).values() if len(table.frame)],
        claims=report.frames["claims"].to_dict("records"),
        figures=report.figures,
        tables_of=tables_of_sections(report.frames, report.origins),
    )


def images_of(*directories: Path) -> dict[str, Path]:
    """Return the images in some directories by name."""
    return {path.stem: path for folder in directories for kind in ("png", "gif") for path in folder.glob(f"*.{kind}")}


def _embedded(path: Path) -> dict[str, Any]:
    """Return a PNG or GIF file for the page: its width on the page [px], and its data in base 64 as a URL."""
    with Image.open(path) as image:
        inches = image.width / image.info.get("dpi", (PX_PER_INCH, PX_PER_INCH))[0]
    data = base64.b64encode(path.read_bytes()).decode()
    return {"width": round(PX_PER_INCH * inches), "url": f"data:image/{path.suffix[1:]};base64,{data}"}


def _all_free(intervals: pd.DataFrame) -> str:
    """Return a sentence with the scores of the all-free baseline, empty if it is not evaluated."""
    found = intervals[intervals["model"] == "all_free"].groupby("metric")["value"].agg(["min", "max"])
    if found.empty:
        return ""
    accuracy, dice = ("{:.3f} to {:.3f}".format(*found.loc[metric]) for metric in ("accuracy", "dice"))
    return f"A prediction of free space everywhere has accuracy {accuracy} and Dice {dice}."


def tables_of_sections(frames: DataFrames, origins: dict[str, Provenance]) -> dict[str, list[Cells]]:
    """Return the tables of each section of the page, by its id; some may have no rows.

    Args:
        frames: the frames.
        origins: provenance of each run by its path.
    """
    calibration = frames["calibration"][frames["calibration"]["recency"] == "all"]
    calibration = calibration[calibration["model"].isin(NETWORKS)]
    return {
        "calibration": [cells_of(_sorted(calibration), CELL, CALIBRATION, "Calibration of the paper's networks")],
        "baselines": [
            cells_of(
                _to_the_papers(frames["differences"]),
                ["experiment", "model", "input"],
                DIFFERENCE,
                "Obstacle IoU with other inputs and without the decay, minus that with the paper's input",
            ),
            cells_of(_sorted(frames["cost"]), CELL, COST, "Size of the networks, and time and memory of a training"),
        ],
        "provenance": [_origins(origins)],
    }


def _sorted(frame: pd.DataFrame) -> pd.DataFrame:
    """Sort rows of cells as in the tables, by experiment, model and encoding."""
    order = frame.assign(rank=frame["model"].map(rank)).sort_values(["experiment", "rank", "model", "encoding"])
    return order.drop(columns="rank")


def _to_the_papers(differences: pd.DataFrame) -> pd.DataFrame:
    """Select the differences in obstacle IoU between other inputs, the ablation included, and the paper's input."""
    rows = differences.query("metric == 'obstacle_iou' and comparison in ['decay', 'encodings']")
    to_paper, from_paper = rows[rows["other"] == PROJECTION], rows[rows["one"] == PROJECTION]
    negated = {"value": -from_paper["value"], "low": -from_paper["high"], "high": -from_paper["low"]}
    both = pd.concat([to_paper, from_paper.assign(one=from_paper["other"], **negated)])
    return _sorted(both.assign(encoding=both["one"])).rename(columns={"encoding": "input"})


def _origins(origins: dict[str, Provenance]) -> Cells:
    rows = []
    for path, step in ((path, origin.steps[-1]) for path, origin in origins.items() if origin.steps):
        hardware, commit = machine_title(**step["hardware"]), short_commit(step["commit"])
        rows.append([path, commit, step["written"][:10], hardware, step["versions"]["torch"]])
    return Cells(["Run", "Commit", "Date", "Hardware", "torch"], rows, "Last step of each run", 5)


def render_published(directory: Path) -> str:
    """Return the report of a published directory.

    Raises:
        ValueError: a table or the provenance cannot be read.
    """
    results = read_published(directory)
    report = Report(
        outputs=Path("outputs", directory.name),
        results=results,
        frames=read_frames(directory),
        figures=images_of(directory, directory / "analysis"),
        origins=read_origins(directory),
    )
    return render(report)
