"""Tidy rows: tables in which the columns experiment, model, encoding and seed identify a run."""

from pathlib import Path
from typing import Any

import pandas as pd

from repro.runs.keys import KEY, RunKey


def keys_of(rows: pd.DataFrame) -> list[RunKey]:
    """Return the key of each row of a tidy table."""
    columns = (rows[name] for name in KEY)
    return [RunKey(e, m, n, None if pd.isna(seed) else int(seed)) for e, m, n, seed in zip(*columns, strict=True)]


def read_rows(path: Path) -> pd.DataFrame:
    """Load a CSV file of tidy rows: experiments are strings, baselines have an empty encoding, seeds are integers."""
    types: dict[Any, Any] = dict.fromkeys(("experiment", "encoding", "trained", "tested"), str) | {"seed": "Int64"}
    rows = pd.read_csv(path, dtype=types)
    return rows.assign(encoding=rows["encoding"].fillna("")) if "encoding" in rows else rows
