"""The paper's tables, and the properties of its test maps that they imply (DEVIATIONS)."""

from functools import cache
from importlib.resources import files
from pathlib import Path

import pandas as pd

from repro.metrics.headings import METRICS
from repro.recordings.format import spec_fingerprint
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.keys import CELL
from repro.system.project import conf_directory
from repro.worlds.spec import read_world, world_spec

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


def free_share(rows: pd.DataFrame) -> pd.Series:
    """Solve accuracy = f recall + (1 - f) specificity for the share of free pixels f."""
    return (rows["accuracy"] - rows["specificity"]) / (rows["recall"] - rows["specificity"])


def paper_rows() -> pd.DataFrame:
    """Return the paper's tables as tidy rows, with the implied scores of an all-free prediction on its maps."""
    table = read_paper()
    average = table[(table["model"] == "average") & (table["encoding"] == PROJECTION)][[*CELL]]
    share = free_share(table.loc[average.index])
    free = average.assign(model="all_free", encoding="", accuracy=share, dice=2 * share / (1 + share))
    long = pd.concat([table, free]).melt(CELL, list(METRICS), "metric")
    return long.assign(of="tables", recency="all", low=float("nan"), high=float("nan"))
