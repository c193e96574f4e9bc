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

import numpy as np
import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import METRICS
from repro.recordings.format import spec_fingerprint
from repro.runs.keys import CELL
from repro.system.places import conf_directory
from repro.world_config import read_world, world_spec

TABLES = files("repro.reporting") / "paper_tables"
WORLDS = conf_directory() / "world" / "paper.yaml"


def world_files(used: set[str]) -> list[str]:
    """Return the names of the files of conf/world that have all of some worlds, given by their fingerprints."""
    return [path.stem for path in sorted(WORLDS.parent.glob("*.yaml")) if used <= worlds_of(path)]


@cache
def worlds_of(path: Path) -> set[str]:
    """Return the fingerprints of the worlds of all experiments of a file in conf/world."""
    world = read_world(path)
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
    return {"coverage": 1 - free_share(rows).item(), "specificity": rows["specificity"].item()}


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
        `all_free_accuracy`. A value that a row does not determine is nan.
    """
    free = free_share(table)
    return table.drop(columns=[*METRICS], errors="ignore").assign(
        free=free,
        free_by_precision=free_share_by_precision(table),
        free_agrees=_agree(free_share, free_share_by_precision, table),
        dice_by_precision=dice_by_precision(table),
        dice_agrees=_agree(dice_by_precision, lambda rows: rows["dice"], table),
        obstacle_iou=obstacle_iou(table),
        all_free_accuracy=free,
        all_free_dice=all_free_dice(free),
        gain=table["accuracy"] - free,
    )


def free_share(rows: pd.DataFrame) -> pd.Series:
    """Solve accuracy = f recall + (1 - f) specificity for the share of free pixels f."""
    return _ratio(rows["accuracy"] - rows["specificity"], rows["recall"] - rows["specificity"])


def free_share_by_precision(rows: pd.DataFrame) -> pd.Series:
    """Solve precision = f recall / (f recall + (1 - f) (1 - specificity)) for the share of free pixels f."""
    wrong = rows["precision"] * (1 - rows["specificity"])
    return _ratio(wrong, wrong + rows["recall"] * (1 - rows["precision"]))


def dice_by_precision(rows: pd.DataFrame) -> pd.Series:
    """Compute Dice as the harmonic mean of precision and recall."""
    return _ratio(2 * rows["precision"] * rows["recall"], rows["precision"] + rows["recall"])


def all_free_dice(free: pd.Series) -> pd.Series:
    """Compute Dice of an all-free prediction from the share of free pixels, which is its accuracy."""
    return 2 * free / (1 + free)


def obstacle_iou(rows: pd.DataFrame) -> pd.Series:
    """Compute the obstacle IoU that the rows imply."""
    free = free_share(rows)
    return _ratio((1 - free) * rows["specificity"], 1 - free + free * (1 - rows["recall"]))


def _ratio(numerator: pd.Series, denominator: pd.Series) -> pd.Series:
    """Divide, with nan where a row determines nothing, as that of a network that predicts obstacles everywhere."""
    return numerator / denominator.where(denominator != 0)


def _agree(
    one: Callable[[pd.DataFrame], pd.Series], other: Callable[[pd.DataFrame], pd.Series], rows: pd.DataFrame
) -> pd.Series:
    """Return whether two numbers computed from a row can be equal before the terms of the row were rounded."""
    half = 0.5e-4  # of the last printed decimal
    names = [name for name in METRICS if name != "ssim"]
    moved = (rows[names] + np.array(signs) for signs in itertools.product((-half, half), repeat=len(names)))
    gaps = pd.concat([one(terms) - other(terms) for terms in moved], axis=1)
    return (gaps.min(axis=1) <= 0) & (gaps.max(axis=1) >= 0)


def paper_rows() -> pd.DataFrame:
    """Return the paper's tables as tidy rows, with the implied scores of an all-free prediction on its maps."""
    table = read_paper()
    average = table[(table["model"] == "average") & (table["encoding"] == PROJECTION)][[*CELL]]
    share = free_share(table.loc[average.index])
    free = average.assign(model="all_free", encoding="", accuracy=share, dice=all_free_dice(share))
    long = pd.concat([table, free]).melt(CELL, list(METRICS), "metric")
    return long.assign(of="tables", recency="all", low=float("nan"), high=float("nan"))
