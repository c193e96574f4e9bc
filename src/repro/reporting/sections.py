"""Figures and small tables of the sections of the HTML report; its template has their texts."""

import base64
from pathlib import Path
from typing import Any

import pandas as pd
from PIL import Image

from repro.baselines.names import rank
from repro.config import PROJECTION
from repro.networks.model import NETWORKS
from repro.reporting.names import tested_titles
from repro.reporting.render import Cells, cells_of, number
from repro.runs.keys import CELL
from repro.runs.provenance import Provenance

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
PX_PER_INCH = 110  # of the images on the page, so that their text has the size of its text


def tables_of_sections(frames: dict[str, pd.DataFrame], origins: dict[str, Provenance]) -> dict[str, list[Cells]]:
    """Return the tables of each section, by its id; some may have no rows.

    Args:
        frames: see `evaluation.analysis.gather`.
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
        "generalization": _across(frames.get("generalization")),
        "provenance": [_origins(origins)],
    }


def embedded(path: Path) -> dict[str, Any]:
    """Return a PNG file for the page: its width on the page [px], and its data in base 64."""
    with Image.open(path) as image:
        inches = image.width / image.info["dpi"][0]
    return {"width": round(PX_PER_INCH * inches), "data": base64.b64encode(path.read_bytes()).decode()}


def _sorted(frame: pd.DataFrame) -> pd.DataFrame:
    """Sort rows of cells as in the tables, by experiment, model and encoding."""
    order = frame.assign(rank=frame["model"].map(rank)).sort_values(["experiment", "rank", "model", "encoding"])
    return order.drop(columns="rank")


def _to_the_papers(differences: pd.DataFrame) -> pd.DataFrame:
    """Select the differences in obstacle IoU between other inputs, the ablation included, and the paper's input."""
    is_input = differences["comparison"].isin(["decay", "encodings"])
    rows = differences[(differences["metric"] == "obstacle_iou") & is_input]
    to_paper, from_paper = rows[rows["other"] == PROJECTION], rows[rows["one"] == PROJECTION]
    negated = {"value": -from_paper["value"], "low": -from_paper["high"], "high": -from_paper["low"]}
    return (
        pd.concat([to_paper, from_paper.assign(one=from_paper["other"], **negated)])
        .assign(encoding=lambda rows: rows["one"])
        .pipe(_sorted)
        .rename(columns={"encoding": "input"})
    )


def _across(frame: pd.DataFrame | None) -> list[Cells]:
    """Return for each network obstacle IoU and accuracy, trained on one experiment (row), tested on one (column)."""
    if frame is None:
        return []
    rows = frame[frame["shift"] == "experiment"]
    return [_across_of(str(title), part) for title, part in rows.groupby(tested_titles(rows), sort=False)]


def _across_of(title: str, frame: pd.DataFrame) -> Cells:
    rows = frame.set_index(["trained", "tested", "metric"])["value"].to_dict()
    trained, tested = (list(dict.fromkeys(frame[name])) for name in ("trained", "tested"))

    def cell(name: str, on: str) -> str:  # empty where the network was not tested
        found = [rows.get((name, on, metric)) for metric in ("obstacle_iou", "accuracy")]
        return " / ".join(number(value) for value in found if value is not None)

    table = [[name, *(cell(name, on) for on in tested)] for name in trained]
    heads = ["Trained on", *(f"tested on {name}" for name in tested)]
    return Cells(heads, table, f"{title}: obstacle IoU / accuracy")


def _origins(origins: dict[str, Provenance]) -> Cells:
    rows = []
    for path, origin in origins.items():
        if origin.steps:
            step = origin.steps[-1]
            machine = step["hardware"]["gpu"] or f"{step['hardware']['cpu_cores']} cores, {step['hardware']['machine']}"
            rows.append([path, str(step["commit"])[:10], step["written"][:10], machine, step["versions"]["torch"]])
    return Cells(["Run", "Commit", "Date", "Hardware", "torch"], rows, "Last step of each run", 5)
