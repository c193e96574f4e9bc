"""Lines that several tasks print."""

import pandas as pd

from repro.metrics.names import SUMMARY
from repro.reporting.results import read_results
from repro.reporting.tables import not_shown, write_tables
from repro.runs.outputs import Outputs


def summary_line(metrics: pd.Series) -> str:
    """Format the main metrics of a run as one line; metrics.csv has all of them."""
    return ", ".join(f"{title} {metrics[name]:.4f}" for name, title in SUMMARY.items())


def print_tables(outputs: Outputs, names: tuple[str, ...]) -> None:
    """Write the tables of the runs in an outputs directory, and print some.

    Raises:
        InputError: a run is damaged, or the runs cannot share a table.
    """
    results = read_results(outputs)
    tables = write_tables(outputs.tables, results)
    for name in names:
        print("\n" + tables[name].to_markdown())
    if names and (note := not_shown(results)):
        print(note)
    print(f"Tables: {outputs.tables}", flush=True)
