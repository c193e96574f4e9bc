"""Lines that several tasks print."""

import sys

import pandas as pd

from repro.metrics.names import SUMMARY
from repro.reporting.tables import write_tables
from repro.runs.outputs import Outputs
from repro.system.errors import InputError


def summary_line(metrics: pd.Series) -> str:
    """Format the main metrics of a run as one line; metrics.csv has all of them."""
    return ", ".join(f"{title} {metrics[name]:.4f}" for name, title in SUMMARY.items())


def print_tables(outputs: Outputs, names: tuple[str, ...]) -> list[str]:
    """Write the tables of the runs in an outputs directory, print some, and return why runs, or all, are left out."""
    errors: list[str] = []
    try:
        tables = write_tables(outputs, errors)
    except InputError as problem:  # the runs cannot share a table
        tables = {}
        errors.append(str(problem))
    for name, table in tables.items():
        if name in names:
            print("\n" + table.to_markdown())
            if table.note:
                print(table.note)
    if tables:
        print(f"Tables: {outputs.tables}", flush=True)
    for error in errors:
        print(f"error: left out of the tables: {error}", file=sys.stderr)
    return errors
