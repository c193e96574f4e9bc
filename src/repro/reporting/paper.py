"""The published tables, and what they give away about the test maps."""

from importlib.resources import files

import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import METRICS
from repro.runs.keys import CELL

TABLES = files("repro.reporting") / "paper_tables"


def read_paper() -> pd.DataFrame:
    """Reads the paper's Tables I and II with their averages: experiment, model, encoding and the six metrics."""
    results = pd.read_csv(str(TABLES / "results.csv"))
    averages = pd.read_csv(str(TABLES / "averages.csv")).assign(model="average")
    table = pd.concat([results, averages], ignore_index=True)
    encoding = table["decay"].map({True: PROJECTION, False: PROJECTION_NO_DECAY})
    return table.assign(experiment=table["experiment"].astype(str), encoding=encoding)[[*CELL, *METRICS]]


def implied_coverage(table: pd.DataFrame) -> pd.Series:
    """Computes the obstacle share of the test maps that each row implies.

    With FREE as the positive class, accuracy = f * recall + (1 - f) * specificity for a free share f.
    """
    free = (table["accuracy"] - table["specificity"]) / (table["recall"] - table["specificity"])
    return 1 - free


def targets(experiment: str) -> dict[str, float]:
    """Says what the recordings of an experiment should come near.

    Returns:
        `coverage`, the obstacle share that the paper's average row implies, and `specificity`, which the
        visibility of the worlds must exceed: nobody predicts obstacles never hit. Empty for an experiment
        that the paper does not have.
    """
    rows = read_paper().query("model == 'average' and encoding == @PROJECTION and experiment == @experiment")
    if rows.empty:
        return {}
    coverage, specificity = implied_coverage(rows).item(), rows["specificity"].item()
    return {"coverage": coverage, "specificity": specificity}
