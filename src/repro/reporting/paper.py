"""The paper's tables, and the properties of its test maps that they imply."""

from importlib.resources import files

import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import METRICS
from repro.runs.keys import CELL

TABLES = files("repro.reporting") / "paper_tables"


def read_paper() -> pd.DataFrame:
    """Load the paper's Tables I and II with their averages: experiment, model, encoding and the six metrics."""
    results = pd.read_csv(str(TABLES / "results.csv"))
    averages = pd.read_csv(str(TABLES / "averages.csv")).assign(model="average")
    table = pd.concat([results, averages], ignore_index=True)
    encoding = table["decay"].map({True: PROJECTION, False: PROJECTION_NO_DECAY})
    return table.assign(experiment=table["experiment"].astype(str), encoding=encoding)[[*CELL, *METRICS]]


def implied_coverage(table: pd.DataFrame) -> pd.Series:
    """Compute the obstacle share of the test maps that each row implies.

    With FREE as the positive class, accuracy = f * recall + (1 - f) * specificity for a free share f.
    """
    free = (table["accuracy"] - table["specificity"]) / (table["recall"] - table["specificity"])
    return 1 - free


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
    coverage, specificity = implied_coverage(rows).item(), rows["specificity"].item()
    return {"coverage": coverage, "specificity": specificity}
