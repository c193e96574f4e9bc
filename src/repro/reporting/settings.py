"""Settings of runs in tidy rows: a column with one JSON object per run, its keys as on the command line.

Rows that were published before the column existed lack some or all settings; these are then not compared.
"""

import json
from collections.abc import Iterable, Iterator
from typing import Any

from repro.runs.config import RunConfig

Settings = dict[str, Any]


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
    return "; ".join(_conflicts(read_cells(cells)))


def _conflicts(all_settings: list[Settings]) -> Iterator[str]:
    for key in dict.fromkeys(key for settings in all_settings for key in settings):
        values = [settings[key] for settings in all_settings if key in settings]
        distinct = dict.fromkeys(json.dumps(value) for value in values)
        if len(distinct) > 1:
            yield f"{key} is {' and '.join(distinct)}"
