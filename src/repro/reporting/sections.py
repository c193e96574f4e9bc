"""The sections of the HTML report after tables and claims: figures and small tables with their text."""

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

CAPTIONS = {
    "results": "Sensor input, prediction and ground truth of U-Net in the experiments and the ablations.",
    "data_representation": "The cumulative dynamic sensor projection of one recording per experiment.",
    "recency": "Obstacle recall and Brier score of U-Net by recency (time since last seen). Occluded pixels were in "
    "the field of view but always hidden. Intervals of 95 % over test worlds.",
    "ages": "Obstacle recall and entropy of U-Net by time since last seen, in bins of five steps. The lidar never sees "
    "the inside of an obstacle, so these pixels are edges of obstacles and obstacles that moved in later.",
    "obstacles": "Recall of single obstacles by time since the last hit; intervals of 95 % over test worlds.",
    "reliability": "Predicted probability of an obstacle against the observed frequency, uncalibrated.",
    "baselines": "Obstacle IoU of the networks (filled) and the classical baselines (open), with intervals of 95 %.",
    "generalization": "Networks under changed sensors, poses and obstacle speeds; intervals of 95 % over worlds.",
    "curves": "U-Net on the paper's input against the number of training pairs, averaged over seeds; at 10,000 pairs "
    "the value extrapolated by the fitted law with its interval of 95 %, and the paper's value.",
    "pairs": "Obstacle IoU of the networks that have a learning curve against the number of training pairs, averaged "
    "over seeds, at the lowest resolution that all of them have; dashed: the upper bound and the inference from scans.",
    "encodings": "Obstacle IoU of U-Net with other inputs and of recurrent networks, with the same training budget and "
    "intervals of 95 %. All encodings except projection and exponential have inverted intensities; their reference is "
    "the encoding negative, the inverted projection.",
}
SECTIONS: list[dict[str, Any]] = [
    {
        "id": "figures",
        "nav": "Examples",
        "title": "Inputs and predictions",
        "text": "Recordings of the test set, which was not used for training or tuning.",
        "images": ("results", "data_representation"),
    },
    {
        "id": "where",
        "nav": "Recency",
        "title": "Prediction quality by recency",
        "text": "The recording determines the time since each pixel was last seen and each obstacle was last hit. "
        "Pixels that were hidden throughout are occluded; pixels outside the field of view throughout are never in "
        "view. The ablation has no time decay: the projection shows all hits in the same gray.",
        "images": ("recency", "ages", "obstacles"),
    },
    {
        "id": "calibration",
        "nav": "Calibration",
        "title": "Calibration of the probabilities",
        "text": "The paper describes the blurry predictions as probabilistic. The expected calibration error is the "
        "mean gap between predicted probability and observed frequency; the Brier score equals reliability - "
        "resolution + uncertainty. Uncalibrated: the probabilities of the network. Temperature-scaled: the logits are "
        "divided by a temperature fitted on validation data.",
        "images": ("reliability",),
    },
    {
        "id": "baselines",
        "nav": "Baselines",
        "title": "Classical baselines and other inputs",
        "text": "The classical baselines are tuned on validation data: last seen (a disc around every hit), an "
        "occupancy grid with forgetting, a grid of static and dynamic occupancy, and a tracker of clusters with "
        "constant velocity.",
        "images": ("baselines", "encodings"),
    },
    {
        "id": "generalization",
        "nav": "Generalization",
        "title": "Generalization under distribution shift",
        "text": "Networks trained on one experiment and tested on the others, and on sensors, poses and speeds outside "
        "their training distribution. The threshold stays at 0.5, so accuracy and IoU may disagree.",
        "images": ("generalization",),
    },
    {
        "id": "curves",
        "nav": "Learning curves",
        "title": "Extrapolation to paper scale",
        "text": "A saturating power law in training pairs and resolution, fitted to smaller trainings; with fewer than "
        "three resolutions it is fitted in pairs alone, at the measured resolution. Held-out point: the largest "
        "training, extrapolated from the smaller ones and then measured.",
        "images": ("curves", "pairs"),
    },
    {
        "id": "provenance",
        "nav": "Provenance",
        "title": "Provenance of the runs",
        "text": "The last step of each run; its provenance.json lists all steps.",
    },
]
CALIBRATION = {
    "brier": ("Brier", 4),
    "reliability": ("reliability", 4),
    "resolution": ("resolution", 4),
    "log_loss": ("log-loss", 4),
    "calibration_error": ("calibration error", 4),
    "temperature": ("temperature", 3),
}
COST = {
    "channels": ("channels", 0),
    "parameters": ("parameters", 0),
    "training_seconds": ("training [s]", 0),
    "peak_memory_gb": ("memory [GB]", 1),
}
EXTRAPOLATED = {
    "pairs": ("pairs", 0),
    "size_px": ("px", 0),
    "value": ("extrapolated", 4),
    "low": ("low", 4),
    "high": ("high", 4),
    "measured": ("measured", 4),
    "paper": ("paper", 4),
}
DIFFERENCE = {"value": ("difference", 4), "low": ("low", 4), "high": ("high", 4)}
EXTRAPOLATED_BY = ["experiment", "encoding", "target", "metric"]
PX_PER_INCH = 110  # of the images on the page, so that their text has the size of its text


def sections(frames: dict[str, pd.DataFrame], figures: dict[str, Path], origins: dict[str, Provenance]) -> list[dict]:
    """Return the sections that have images or rows.

    Args:
        frames: see `evaluation.analysis.gather`.
        figures: PNG files by name.
        origins: provenance of each run by its path.

    Returns:
        for each section: id, nav (its name in the navigation), title, text, images (caption, width, data) and tables
        (caption, heads, rows, and text_columns, the number of leading columns with text).
    """
    calibration = frames["calibration"][frames["calibration"]["recency"] == "all"]
    calibration = calibration[calibration["model"].isin(NETWORKS)]
    tables = {
        "calibration": [
            cells_of(_sorted(calibration), [*CELL, "method"], CALIBRATION, "Calibration of the paper's networks")
        ],
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
        "curves": [_extrapolated(frames.get("extrapolated"))],
        "provenance": [_origins(origins)],
    }
    filled = [
        {
            **section,
            "images": [_image(CAPTIONS[name], figures[name]) for name in section.get("images", ()) if name in figures],
            "tables": tables.get(section["id"], []),
        }
        for section in SECTIONS
    ]
    return [section for section in filled if section["images"] or any(table.rows for table in section["tables"])]


def _image(caption: str, path: Path) -> dict[str, Any]:
    png = path.read_bytes()
    with Image.open(path) as image:
        inches = image.width / image.info["dpi"][0]
    return {"caption": caption, "width": round(PX_PER_INCH * inches), "data": base64.b64encode(png).decode()}


def _sorted(frame: pd.DataFrame) -> pd.DataFrame:
    """Sort rows of cells as in the tables, by experiment, model and encoding."""
    order = frame.assign(rank=frame["model"].map(rank)).sort_values(["experiment", "rank", "model", "encoding"])
    return order.drop(columns="rank")


def _extrapolated(frame: pd.DataFrame | None) -> Cells:
    caption = "U-Net at the paper's scale, and at a held-out point"
    rows = pd.DataFrame(columns=EXTRAPOLATED_BY) if frame is None else frame[frame["metric"] != "dice"]
    return cells_of(rows, EXTRAPOLATED_BY, EXTRAPOLATED, caption)


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
