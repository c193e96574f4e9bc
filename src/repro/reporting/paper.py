"""The paper's tables, and the properties of its test maps that they imply."""

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import METRICS
from repro.recordings.format import spec_fingerprint
from repro.reporting.audit import free_share
from repro.runs.keys import CELL
from repro.world_config import read_world, world_spec

TABLES = files("repro.reporting") / "paper_tables"
WORLDS = Path(__file__).parents[3] / "conf" / "world" / "paper.yaml"


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
