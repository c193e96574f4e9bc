"""Lines that several tasks print."""

import sys

import pandas as pd

from repro.metrics.names import SUMMARY
from repro.reporting.results import read_results
from repro.reporting.tables import not_shown, write_tables
from repro.runs.outputs import Outputs
from repro.system.errors import InputError


def summary_line(metrics: pd.Series) -> str:
    """Format the main metrics of a run as one line; metrics.csv has all of them."""
    return ", ".join(f"{title} {metrics[name]:.4f}" for name, title in SUMMARY.items())


def print_tables(outputs: Outputs, names: tuple[str, ...]) -> list[str]:
    """Write the tables of the runs in an outputs directory, print some, and return why runs, or all, are left out."""
    errors: list[str] = []
    try:
        results = read_results(outputs, errors)
        tables = write_tables(outputs.tables, results)
        for name in names:
            print("\n" + tables[name].to_markdown())
        if names and (note := not_shown(results)):
            print(note)
        print(f"Tables: {outputs.tables}", flush=True)
    except InputError as problem:  # the runs cannot share a table
        errors.append(str(problem))
    for error in errors:
        print(f"error: left out of the tables: {error}", file=sys.stderr)
    return errors
