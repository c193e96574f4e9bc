"""Audit: whether a results table agrees with itself, and what its numbers say of obstacles.

Every row of the paper's metrics says more than once how much of the map is free and what Dice is. Where FREE is
positive and the counts are pooled, what it says agrees to the digits printed; where it does not, a number is wrong or
means something else. Nothing but the table is needed, so any table can be audited: the paper's, ours, someone else's.
"""

import itertools
from collections.abc import Callable

import pandas as pd

from repro.metrics.names import METRICS

Row = dict[str, float]


def audit(table: pd.DataFrame, digits: int = 4) -> pd.DataFrame:
    """Audits rows of metrics with FREE as the positive class.

    Args:
        table: accuracy, dice, precision, recall, specificity in [0, 1], and any columns that name the rows.
        digits: decimals the numbers are given to; what rounding alone can explain is not held against a row.

    Returns:
        the columns that name the rows, then: `free`, the share of free pixels by accuracy, recall and specificity;
        `free_by_precision`, by precision, recall and specificity; `free_agrees`; `dice_by_precision`, 2PR / (P + R);
        `dice_agrees`; `obstacle_iou`, which the row implies; `all_free_accuracy` and `all_free_dice`, which calling
        everything free scores on the same maps; `gain`, by how much the accuracy is above that.
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
                "free_agrees": _agree(free_share, free_share_by_precision, values, digits),
                "dice_by_precision": dice_by_precision(values),
                "dice_agrees": _agree(dice_by_precision, lambda given: given["dice"], values, digits),
                "obstacle_iou": obstacle_iou(values),
                "all_free_accuracy": free,
                "all_free_dice": 2 * free / (1 + free),
                "gain": values["accuracy"] - free,
            }
        )
    return pd.DataFrame(rows)


def audit_averages(table: pd.DataFrame, digits: int = 4) -> pd.DataFrame:
    """Compares the rows `average` with the means of their rows, metric by metric.

    Args:
        table: experiment, model, encoding and the metrics.
        digits: decimals the numbers are given to.

    Returns:
        experiment, encoding, metric, printed, mean, agrees.
    """
    keys, printed = ["experiment", "encoding"], table[table["model"] == "average"]
    means = table[table["model"] != "average"].groupby(keys)[list(METRICS)].mean()
    rows = []
    for _, row in printed.iterrows():
        for metric in METRICS:
            mean = float(means.loc[(row["experiment"], row["encoding"]), metric])
            agrees = abs(mean - row[metric]) <= 1.01 * 10**-digits
            rows.append([row["experiment"], row["encoding"], metric, row[metric], mean, agrees])
    return pd.DataFrame(rows, columns=[*keys, "metric", "printed", "mean", "agrees"])


def free_share(row: Row) -> float:
    """Solves accuracy = f recall + (1 - f) specificity for the share of free pixels f."""
    return (row["accuracy"] - row["specificity"]) / (row["recall"] - row["specificity"])


def free_share_by_precision(row: Row) -> float:
    """Solves precision = f recall / (f recall + (1 - f) (1 - specificity)) for the share of free pixels f."""
    wrong = row["precision"] * (1 - row["specificity"])
    return wrong / (wrong + row["recall"] * (1 - row["precision"]))


def dice_by_precision(row: Row) -> float:
    """Computes Dice as the harmonic mean of precision and recall."""
    return 2 * row["precision"] * row["recall"] / (row["precision"] + row["recall"])


def obstacle_iou(row: Row) -> float:
    """Computes the IoU of obstacles that the row implies."""
    free = free_share(row)
    hit = (1 - free) * row["specificity"]
    return hit / (1 - free + free * (1 - row["recall"]))


def _agree(one: Callable[[Row], float], other: Callable[[Row], float], row: Row, digits: int) -> bool:
    """Says whether two numbers computed from a row can be the same before their terms were rounded."""
    half = 0.5 * 10**-digits
    low = high = one(row) - other(row)
    for signs in itertools.product((-half, half), repeat=len(row)):
        moved = {name: value + sign for (name, value), sign in zip(row.items(), signs, strict=True)}
        gap = one(moved) - other(moved)
        low, high = min(low, gap), max(high, gap)
    return low <= 0 <= high
