"""Tidy rows of runs, in which the columns experiment, model, encoding and seed identify a run: evaluated or published.

The column settings has one JSON object per run, its keys as on the command line. Rows that were published before the
column existed lack some or all settings; these are then not compared.
"""

import itertools
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from repro.metrics.headings import METRICS, TABLE_METRICS
from repro.reporting.paper import are_papers
from repro.runs.config import RunConfig
from repro.runs.directories import Run
from repro.runs.keys import KEY, RunKey
from repro.runs.outputs import Outputs, check_together
from repro.runs.provenance import Provenance, Status
from repro.system.errors import InputError
from repro.system.files import first_line, read_typed

MEASURED = (*METRICS, "obstacle_iou")  # metrics that every evaluated run has
FACTS = ("train_pairs", "test_pairs", "epochs", "training_seconds")
FROM_GIT = "restore it from git"


def read_results(outputs: Outputs) -> pd.DataFrame:
    """Read every evaluated run below an outputs directory, one row each.

    Returns:
        experiment, model, encoding, seed, all metrics, and scale, size_px, train_pairs, test_pairs, epochs,
        training_seconds, papers_worlds, whether the worlds are those of conf/world/paper.yaml, and settings. Empty if
        no run is evaluated.

    Raises:
        InputError: a run is damaged, or the runs cannot share a table, see `outputs.check_together`.
    """
    configs = {run: run.config() for run in outputs.runs() if run.status is Status.evaluated}
    if not configs:
        return pd.DataFrame()
    rows = pd.DataFrame([_row(outputs, run, config) for run, config in configs.items()])
    for run, config in configs.items():
        check_together(config, {other: configs[other] for other in itertools.takewhile(run.__ne__, configs)})
    return _with_all_columns(rows.astype({"seed": "Int64"}))  # baselines have no seed


def _row(outputs: Outputs, run: Run, config: RunConfig) -> dict[str, Any]:
    origin, expected = run.provenance(), outputs.run(config.key)
    if expected != run:
        raise InputError(f"{run} holds the run of {expected}, by its config.yaml: move it there or delete it")
    return {
        **{name: getattr(config.key, name) for name in KEY},
        **{str(name): value for name, value in run.read_metrics().items()},
        "scale": config.data.scale,
        "papers_worlds": are_papers(config.data.worlds),
        "size_px": config.data.size_px,
        **{name: origin.fact(name) for name in FACTS},
        "settings": json.dumps(config.settings) if config.settings else "",
    }


def settings_of(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the settings of runs as JSON texts, a column each; nan where a run has none of that name."""
    read = [json.loads(cell) if isinstance(cell, str) and cell else {} for cell in rows["settings"]]
    return pd.DataFrame([{key: json.dumps(value) for key, value in settings.items()} for settings in read], rows.index)


def conflicts(rows: pd.DataFrame) -> str:
    """Name the settings with different values in runs that must share all, `train.batch_size is 2 and 8`; or empty."""
    values = {name: column.dropna().unique() for name, column in settings_of(rows).items()}
    return "; ".join(f"{name} is {' and '.join(found)}" for name, found in values.items() if len(found) > 1)


def keys_of(rows: pd.DataFrame) -> list[RunKey]:
    """Return the key of each row of a tidy table."""
    columns = (rows.get(name, ()) for name in KEY)  # none without runs
    return [RunKey(e, m, n, None if pd.isna(seed) else int(seed)) for e, m, n, seed in zip(*columns, strict=True)]


def read_rows(path: Path, columns: Iterable[str] = (), fix: str = "restore or delete it") -> pd.DataFrame:
    """Load a CSV file of tidy rows: experiments are strings, baselines have an empty encoding, seeds are integers.

    Args:
        path: the file.
        columns: the columns that it must have.
        fix: what to do if the file cannot be read; appended to the message.

    Raises:
        InputError: the file cannot be read, lacks a column, or has a seed that is no integer.
    """
    types = dict.fromkeys(("experiment", "encoding", "trained", "tested"), str)
    try:
        rows = pd.read_csv(path, dtype=types)
        rows = rows.astype({"seed": "Int64"}) if "seed" in rows else rows  # baselines have no seed
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path} cannot be read ({first_line(error)}): {fix}") from error
    if missing := [name for name in columns if name not in rows]:
        raise InputError(f"{path} cannot be read (it lacks the columns {', '.join(missing)}): {fix}")
    return rows.assign(encoding=rows["encoding"].fillna("")) if "encoding" in rows else rows


def read_published(directory: Path) -> pd.DataFrame:
    """Load the runs.csv of a published directory, with the columns of `read_results`.

    Raises:
        InputError: the directory has no runs.csv, or it cannot be read, or it has a run twice or without its metrics.
    """
    path = directory / "runs.csv"
    if not path.is_file():
        published = sorted(path.parent.name for path in directory.parent.glob("*/runs.csv"))
        raise InputError(
            f"no results are published in {directory}; published results: {', '.join(published) or 'none'}"
        )
    rows = read_rows(path, (*KEY, *MEASURED, "scale", "size_px", *FACTS), FROM_GIT)
    wrong = [name for name in MEASURED if not pd.to_numeric(rows[name], errors="coerce").between(-1, 1).all()]
    if wrong or rows.empty or rows.duplicated(KEY).any():
        expected = f"one row per run, with {', '.join(wrong or MEASURED)} from -1 to 1"
        raise InputError(f"{path} cannot be read (expected {expected}): {FROM_GIT}")
    return _with_all_columns(rows)


def _with_all_columns(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the columns that are younger than all runs, without values."""
    return rows.reindex(columns=list(dict.fromkeys([*rows.columns, "papers_worlds", "settings", *TABLE_METRICS])))


def read_frames(directory: Path) -> dict[str, pd.DataFrame]:
    """Load the tables of the analysis of a published directory, and `costs`, by their names."""
    return {path.stem: read_rows(path) for path in (*directory.glob("analysis/*.csv"), *directory.glob("costs.csv"))}


def read_origins(directory: Path) -> dict[str, Provenance]:
    """Load the provenance of the runs of a published directory, by their paths.

    Raises:
        InputError: provenance.json cannot be read.
    """
    return read_typed(dict[str, Provenance], directory / "provenance.json", FROM_GIT)


def recordings_of(origins: dict[str, Provenance], experiment: str) -> set[object]:
    """Return the checksums of the recordings of the runs of an experiment."""
    of_experiment = (origin for path, origin in origins.items() if RunKey.parse(path).experiment == experiment)
    return {origin.fact("recordings") for origin in of_experiment}


def of_papers_worlds(rows: pd.DataFrame, results: pd.DataFrame) -> pd.DataFrame:
    """Return the rows without the experiments whose runs, see `read_results`, have other worlds than the paper's."""
    return rows[~rows["experiment"].isin(results.loc[results["papers_worlds"].eq(False), "experiment"])]
