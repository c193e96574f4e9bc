"""The sections of the page below tables and claims: figures and small tables with the words around them."""

import base64
from pathlib import Path
from typing import Any

import pandas as pd

from repro.config import NETWORKS, PROJECTION
from repro.reporting.names import TITLES
from repro.runs.keys import CELL
from repro.runs.provenance import Provenance

CAPTIONS = {
    "results": "Sensor input, prediction and truth of U-Net in the experiments and their ablations.",
    "data_representation": "The cumulative dynamic sensor projection of one recording of each experiment.",
    "recency": "Obstacle pixels found by U-Net, and its Brier score, by when a pixel was last inside the visible "
    "region; intervals of 95 % over worlds.",
    "ages": "By how long ago the lidar last saw a pixel: the share of obstacle pixels found, and how unsure the "
    "prediction is. An obstacle's inside is never seen, so these are edges, and what has moved in since.",
    "obstacles": "Share of each obstacle that is found, by when a beam last hit it; intervals of 95 % over worlds.",
    "reliability": "Predicted probability of an obstacle against how often there is one.",
    "baselines": "Obstacle IoU of networks (filled) and classical baselines (open), with intervals of 95 %.",
    "generalization": "U-Net with changed worlds; intervals of 95 % over test worlds.",
    "curves": "U-Net from the paper's input by the number of training pairs, seeds averaged; at 10,000 pairs what "
    "the fitted law extrapolates, with an interval of 95 %, and the paper's own number.",
    "encodings": "Obstacle IoU from other inputs than the paper's, same budget, with intervals of 95 %. All but "
    "projection and exponential are fed as ones on zeros, so the gain of each is to be read against negative.",
}
SECTIONS: list[dict[str, Any]] = [
    {
        "id": "figures",
        "nav": "Figures",
        "title": "What goes in and what comes out",
        "text": "Test recordings that no network was trained or tuned on.",
        "images": ("results", "data_representation"),
    },
    {
        "id": "where",
        "nav": "Where and when",
        "title": "Where and when it is right",
        "text": "From the recording alone it is known when each pixel was last in view and each obstacle last hit. "
        "Without the time decay a network cannot tell old from new, and loses most at what was seen last.",
        "images": ("recency", "ages", "obstacles"),
    },
    {
        "id": "calibration",
        "nav": "Calibration",
        "title": "Can the probabilities be believed?",
        "text": "The paper calls the blurry predictions probabilistic. The expected calibration error is the mean "
        "gap between what is predicted and what comes true; the Brier score is reliability - resolution + "
        "uncertainty. Tempered: logits divided by a temperature fitted on validation data.",
        "images": ("reliability",),
    },
    {
        "id": "baselines",
        "nav": "Baselines",
        "title": "Against methods made by hand, and other inputs",
        "text": "Made by hand and tuned on validation data: last seen (a disc around every hit), an occupancy grid "
        "that forgets, a grid of static and dynamic occupancy, a tracker of clusters with constant velocity.",
        "images": ("baselines", "encodings"),
    },
    {
        "id": "generalization",
        "nav": "Transfer",
        "title": "Does it travel?",
        "text": "U-Net of one experiment on the recordings of another, and on sensors, poses and speeds that it "
        "has not learned. Accuracy and IoU need not agree: the threshold stays at 0.5.",
        "images": ("generalization",),
    },
    {
        "id": "curves",
        "nav": "Learning curves",
        "title": "What paper scale would give",
        "text": "A saturating power law in pairs and pixels, fitted to trainings with fewer of both; with fewer than "
        "three resolutions in pairs alone, at the resolution measured. Held-out point: the largest training as "
        "extrapolated from the smaller ones.",
        "images": ("curves",),
    },
    {
        "id": "provenance",
        "nav": "Provenance",
        "title": "Where every number comes from",
        "text": "The last step of each run directory; all steps are in its provenance.json.",
    },
]
CALIBRATION = {
    "brier": "Brier",
    "reliability": "reliability",
    "resolution": "resolution",
    "log_loss": "log-loss",
    "calibration_error": "calibration error",
    "temperature": "temperature",
}
COST = {
    "channels": "channels",
    "parameters": "parameters",
    "training_seconds": "training [s]",
    "peak_memory_gb": "memory [GB]",
}
EXTRAPOLATED = {
    "pairs": "pairs",
    "size_px": "px",
    "value": "extrapolated",
    "low": "low",
    "high": "high",
    "measured": "measured",
    "paper": "paper",
}
DIFFERENCE = {"value": "obstacle IoU, to the projection", "low": "low", "high": "high"}


def sections(frames: dict[str, pd.DataFrame], figures: dict[str, Path], origins: dict[str, Provenance]) -> list[dict]:
    """Makes the sections for which there is something to show.

    Args:
        frames: see `evaluation.analysis.gather`.
        figures: PNG files, by name.
        origins: where each run came from, by its place.

    Returns:
        id, nav (its short name), title, text, images (alt, caption, data) and tables (caption, heads, rows, words: how
        many columns hold words) of each.
    """

    def images(*names: str) -> list[dict[str, str]]:
        shown = [(CAPTIONS[name], figures[name].read_bytes()) for name in names if name in figures]
        return [{"alt": words, "caption": words, "data": base64.b64encode(png).decode()} for words, png in shown]

    calibration = frames["calibration"][frames["calibration"]["recency"] == "all"]
    calibration = calibration[calibration["model"].isin(NETWORKS)]
    tables = {
        "calibration": [_table(calibration, [*CELL, "method"], CALIBRATION)],
        "baselines": [
            _table(_to_the_papers(frames["differences"]), ["experiment", "model", "input"], DIFFERENCE),
            _table(frames["cost"], CELL, COST),
        ],
        "generalization": [_across(frames.get("generalization"))],
        "curves": [_extrapolated(frames.get("extrapolated"))],
        "provenance": [_origins(origins)],
    }
    made = [
        {**section, "images": images(*section.get("images", ())), "tables": tables.get(section["id"], [])}
        for section in SECTIONS
    ]
    return [section for section in made if section["images"] or any(table["rows"] for table in section["tables"])]


def _table(frame: pd.DataFrame, names: list[str], numbers: dict[str, str]) -> dict[str, Any]:
    """Return a table of some columns of a frame, each column of numbers with one number of decimals."""
    kept = {column: head for column, head in numbers.items() if column in frame}
    rows = [[TITLES.get(str(value), str(value)) for value in cells] for cells in frame[names].itertuples(index=False)]
    for column in kept:
        digits = 0 if (frame[column].abs().max() >= 100 or (frame[column].dropna() % 1 == 0).all()) else 4
        for row, value in zip(rows, frame[column], strict=True):
            row.append("" if pd.isna(value) else f"{value:z,.{digits}f}")
    heads = [*(name.capitalize() for name in names), *kept.values()]
    return {"caption": "", "heads": heads, "rows": rows, "words": len(names)}


def _extrapolated(frame: pd.DataFrame | None) -> dict[str, Any]:
    if frame is None:
        return {"caption": "", "heads": [], "rows": [], "words": 1}
    return _table(frame[frame["metric"] != "dice"], ["experiment", "encoding", "target", "metric"], EXTRAPOLATED)


def _to_the_papers(differences: pd.DataFrame) -> pd.DataFrame:
    """Select the differences in obstacle IoU to the paper's input, of its ablation and of other encodings."""
    is_input = differences["comparison"].isin(["decay", "encodings"])
    rows = differences[(differences["metric"] == "obstacle_iou") & is_input]
    ours, theirs = rows[rows["other"] == PROJECTION], rows[rows["one"] == PROJECTION]
    turned = theirs.assign(one=theirs["other"], value=-theirs["value"], low=-theirs["high"], high=-theirs["low"])
    return pd.concat([ours, turned]).rename(columns={"one": "input"}).sort_values(["experiment", "model", "value"])


def _across(frame: pd.DataFrame | None) -> dict[str, Any]:
    """Obstacle IoU and accuracy of the network of each experiment (row) on each experiment (column)."""
    if frame is None:
        return {"caption": "", "heads": [], "rows": [], "words": 1}
    rows = frame[frame["shift"] == "experiment"].set_index(["trained", "tested", "metric"])["value"]
    names = list(dict.fromkeys(trained for trained, *_ in rows.index))
    table = [
        [name, *(f"{rows[name, on, 'obstacle_iou']:.3f} / {rows[name, on, 'accuracy']:.3f}" for on in names)]
        for name in names
    ]
    heads = ["Trained on", *(f"tested on {name}" for name in names)]
    return {"caption": "Obstacle IoU / accuracy.", "heads": heads, "rows": table, "words": 1}


def _origins(origins: dict[str, Provenance]) -> dict[str, Any]:
    rows = []
    for place, origin in origins.items():
        if origin.steps:
            step = origin.steps[-1]
            machine = step["hardware"]["gpu"] or f"{step['hardware']['cpu_cores']} cores, {step['hardware']['machine']}"
            rows.append([place, str(step["commit"])[:10], step["written"][:10], machine, step["versions"]["torch"]])
    return {"caption": "", "heads": ["Run", "Commit", "Day", "Hardware", "torch"], "rows": rows, "words": 5}
