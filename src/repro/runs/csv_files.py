"""Tables that are read back from a run directory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from repro.system.errors import InputError
from repro.system.files import first_line

if TYPE_CHECKING:
    import pandas as pd


def read_table(path: Path, columns: tuple[str, ...], fix: str) -> pd.DataFrame:
    """Read a CSV file that has at least one row and the required columns.

    Args:
        path: the file.
        columns: the required columns, which must not have missing values.
        fix: what to do if the file cannot be read; appended to the message.

    Raises:
        InputError: the file is missing, truncated, empty, or lacks a column or a value.
    """
    import pandas as pd  # slow to import, and recording does not need it

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({first_line(error)}): {fix}") from error
    missing = [name for name in columns if name not in table]
    if missing or table.empty or table[list(columns)].isna().any(axis=None):
        problem = f"it lacks {', '.join(missing)}" if missing else "it lacks values"
        raise InputError(f"{path} cannot be read ({problem}): {fix}")
    return table
