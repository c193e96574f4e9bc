"""The paper's tables, the properties of its test maps that they imply, and the audit of any such table.

Every row of the paper's metrics determines the share of free pixels and Dice in two ways. If FREE is the positive class
and the counts are pooled, both values agree to the printed digits; for means over images they nearly agree (DEVIATIONS,
"What the paper's tables imply"). Otherwise a number is wrong or has another definition. The audit needs only a table,
so it applies to the paper's, ours and any other.
"""

import itertools
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import METRICS
from repro.recordings.format import spec_fingerprint
from repro.runs.keys import CELL
from repro.system.places import conf_directory
from repro.world_config import read_world, world_spec

Row = dict[str, float]
TABLES = files("repro.reporting") / "paper_tables"
WORLDS = conf_directory() / "world" / "paper.yaml"


def world_files(used: set[str]) -> list[str]:
    """Return the names of the files of conf/world that have all of some worlds, given by their fingerprints."""
    return [path.stem for path in sorted(WORLDS.parent.glob("*.yaml")) if used <= worlds_of(path)]


@cache
def worlds_of(path: Path) -> set[str]:
    """Return the fingerprints of the worlds of all experiments of a file in conf/world."""
    return fingerprints_of(read_world(path))


def fingerprints_of(world: dict[str, Any]) -> set[str]:
    """Return the fingerprints of the worlds of all experiments of a configuration."""
    return {spec_fingerprint(world_spec(world, experiment)) for experiment in world["experiments"]}


def are_papers(worlds: str) -> bool:
    """Return whether worlds, given by their fingerprint, are ours for the paper, those of conf/world/paper.yaml."""
    return worlds in worlds_of(WORLDS)


def read_paper() -> pd.DataFrame:
    """Load the paper's Tables I and II with their averages: experiment, model, encoding and the six metrics."""
    results = pd.read_csv(str(TABLES / "results.csv"))
    averages = pd.read_csv(str(TABLES / "averages.csv")).assign(model="average")
    table = pd.concat([results, averages], ignore_index=True)
    encoding = table["decay"].map({True: PROJECTION, False: PROJECTION_NO_DECAY})
    return table.assign(experiment=table["experiment"].astype(str), encoding=encoding)[[*CELL, *METRICS]]


def targets(experiment: str) -> dict[str, float]:
    """Return the target statistics of the recordings of an experiment.

    Returns:
        `coverage`, the obstacle share that the paper's average row implies, and `specificity`, a lower bound of the
        visibility of the worlds, because obstacles that are never hit cannot be predicted. Empty for an experiment
        that is not in the paper.
    """
    rows = read_paper().query("model == 'average' and encoding == @PROJECTION and experiment == @experiment")
    if rows.empty:
        return {}
    row = {name: rows[name].item() for name in METRICS}
    return {"coverage": 1 - free_share(row), "specificity": row["specificity"]}


AUDIT = (  # of the audit, after those that identify the rows
    *("free", "free_by_precision", "free_agrees", "dice_by_precision", "dice_agrees", "obstacle_iou"),
    *("all_free_accuracy", "all_free_dice", "gain"),
)


def audit(table: pd.DataFrame) -> pd.DataFrame:
    """Audit rows of metrics with FREE as the positive class.

    Two values agree if rounding to four decimals can explain their difference.

    Args:
        table: accuracy, dice, precision, recall, specificity in [0, 1], and any columns that identify the rows.

    Returns:
        the identifying columns, then: `free`, the share of free pixels implied by accuracy, recall and specificity;
        `free_by_precision`, the same implied by precision, recall and specificity; `free_agrees`; `dice_by_precision`,
        2PR / (P + R); `dice_agrees`; `obstacle_iou`, implied by the row; `all_free_accuracy` and `all_free_dice`, the
        scores of an all-free prediction on the same maps; `gain`, the difference between accuracy and
        `all_free_accuracy`.
    """
    names = [name for name in table.columns if name not in METRICS]
    rows = []
    for _, row in table.iterrows():
        values = {name: float(row[name]) for name in METRICS if name != "ssim"}
        free = free_share(values)
        rows.append(
            {
                **{name: row[name] for name in names},
                "free": free,
                "free_by_precision": free_share_by_precision(values),
                "free_agrees": _agree(free_share, free_share_by_precision, values),
                "dice_by_precision": dice_by_precision(values),
                "dice_agrees": _agree(dice_by_precision, lambda given: given["dice"], values),
                "obstacle_iou": obstacle_iou(values),
                "all_free_accuracy": free,
                "all_free_dice": 2 * free / (1 + free),
                "gain": values["accuracy"] - free,
            }
        )
    return pd.DataFrame(rows, columns=[*names, *AUDIT])


def free_share(row: Row) -> float:
    """Solve accuracy = f recall + (1 - f) specificity for the share of free pixels f."""
    return _ratio(row["accuracy"] - row["specificity"], row["recall"] - row["specificity"])


def free_share_by_precision(row: Row) -> float:
    """Solve precision = f recall / (f recall + (1 - f) (1 - specificity)) for the share of free pixels f."""
    wrong = row["precision"] * (1 - row["specificity"])
    return _ratio(wrong, wrong + row["recall"] * (1 - row["precision"]))


def dice_by_precision(row: Row) -> float:
    """Compute Dice as the harmonic mean of precision and recall."""
    return _ratio(2 * row["precision"] * row["recall"], row["precision"] + row["recall"])


def obstacle_iou(row: Row) -> float:
    """Compute the obstacle IoU that the row implies."""
    free = free_share(row)
    hit = (1 - free) * row["specificity"]
    return _ratio(hit, 1 - free + free * (1 - row["recall"]))


def _ratio(numerator: float, denominator: float) -> float:
    """Divide, with nan where a row determines nothing, as that of a network that predicts obstacles everywhere."""
    return numerator / denominator if denominator else float("nan")


def _agree(one: Callable[[Row], float], other: Callable[[Row], float], row: Row) -> bool:
    """Return whether two numbers computed from a row can be equal before the terms of the row were rounded."""
    half = 0.5e-4  # of the last printed decimal
    low = high = one(row) - other(row)
    for signs in itertools.product((-half, half), repeat=len(row)):
        moved = {name: value + sign for (name, value), sign in zip(row.items(), signs, strict=True)}
        gap = one(moved) - other(moved)
        low, high = min(low, gap), max(high, gap)
    return low <= 0 <= high
