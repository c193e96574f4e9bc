"""Lines that several tasks print."""

import sys

import pandas as pd

from repro.metrics.names import SUMMARY
from repro.reporting.tables import write_tables
from repro.runs.outputs import Outputs


def summary_line(metrics: pd.Series) -> str:
    """Format the main metrics of a run as one line; metrics.csv has all of them."""
    return ", ".join(f"{title} {metrics[name]:.4f}" for name, title in SUMMARY.items())


def print_tables(outputs: Outputs, names: tuple[str, ...]) -> list[str]:
    """Write the tables of the runs in an outputs directory, print some, and return why runs were left out."""
    errors: list[str] = []
    for name, table in write_tables(outputs, errors).items():
        if name in names:
            print("\n" + table.to_markdown())
            if table.note:
                print(table.note)
    print(f"Tables: {outputs.tables}", flush=True)
    for error in errors:
        print(f"error: left out of the tables: {error}", file=sys.stderr)
    return errors
