"""Tidy rows: tables in which the columns experiment, model, encoding and seed identify a run.

The column settings has one JSON object per run, its keys as on the command line. Rows that were published before the
column existed lack some or all settings; these are then not compared.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from repro.metrics.names import METRICS
from repro.runs.config import RunConfig
from repro.runs.keys import KEY, RunKey
from repro.system.errors import InputError
from repro.system.files import first_line

Settings = dict[str, Any]
MEASURED = (*METRICS, "obstacle_iou")  # metrics that every evaluated run has
FIX = "restore or delete it"


def keys_of(rows: pd.DataFrame) -> list[RunKey]:
    """Return the key of each row of a tidy table."""
    columns = (rows[name] for name in KEY)
    return [RunKey(e, m, n, None if pd.isna(seed) else int(seed)) for e, m, n, seed in zip(*columns, strict=True)]


def read_rows(path: Path, columns: Iterable[str] = ()) -> pd.DataFrame:
    """Load a CSV file of tidy rows: experiments are strings, baselines have an empty encoding, seeds are integers.

    Args:
        path: the file.
        columns: the columns that it must have.

    Raises:
        ValueError: the file cannot be read, lacks a column, or has a seed that is no integer.
    """
    types = dict.fromkeys(("experiment", "encoding", "trained", "tested"), str)
    try:
        rows = pd.read_csv(path, dtype=types)
        rows = rows.astype({"seed": "Int64"}) if "seed" in rows else rows  # baselines have no seed
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path} cannot be read ({first_line(error)}): {FIX}") from error
    if not isinstance(rows.index, pd.RangeIndex):  # pandas takes the first values of such rows as their names
        raise InputError(f"{path} cannot be read (its rows have more values than its header has columns): {FIX}")
    missing = [name for name in columns if name not in rows]
    if missing:
        raise InputError(f"{path} cannot be read (it lacks the columns {', '.join(missing)}): {FIX}")
    return rows.assign(encoding=rows["encoding"].fillna("")) if "encoding" in rows else rows


def settings_cell(config: RunConfig) -> str:
    """Return the settings of a run for a cell of a table; empty for a baseline."""
    return json.dumps(config.settings) if config.settings else ""


def read_cells(cells: Iterable[object]) -> list[Settings]:
    """Return the settings in the cells of a column; of an empty cell, {}."""
    return [json.loads(cell) if isinstance(cell, str) and cell else {} for cell in cells]


def usual(all_settings: Iterable[Settings]) -> Settings:
    """Return the most frequent value of every setting, the first of several."""
    values: dict[str, list[Any]] = {}
    for settings in all_settings:
        for key, value in settings.items():
            values.setdefault(key, []).append(value)
    return {key: max(each, key=each.count) for key, each in values.items()}


def changed(settings: Settings, reference: Settings) -> Settings:
    """Return the settings with other values than in a reference that has them, too."""
    return {key: value for key, value in settings.items() if key in reference and value != reference[key]}


def conflicts(cells: Iterable[object]) -> str:
    """Name the settings with different values in runs that must share all, `train.batch_size is 2 and 8`; or empty."""
    values: dict[str, list[str]] = {}
    for settings in read_cells(cells):
        for key, value in settings.items():
            values.setdefault(key, []).append(json.dumps(value))
    return "; ".join(
        f"{key} is {' and '.join(dict.fromkeys(each))}" for key, each in values.items() if len({*each}) > 1
    )
