"""Lines that several tasks print."""

import pandas as pd

from repro.metrics.headings import SUMMARY
from repro.reporting.answer import answer, decay_table
from repro.reporting.results import read_results
from repro.reporting.tables import TABLES, not_shown, write_tables
from repro.runs.outputs import Outputs


def summary_line(metrics: pd.Series) -> str:
    """Format the main metrics of a run as one line; metrics.csv has all of them."""
    return ", ".join(f"{title} {metrics[name]:.4f}" for name, title in SUMMARY.items())


def print_tables(outputs: Outputs, names: tuple[str, ...]) -> None:
    """Write the tables of the runs in an outputs directory, print how close they are to the paper, and some of them.

    Where runs with and without decay can be compared, both tables and the difference are printed.

    Args:
        names: of `tables.TABLES`, that are printed in any case; none prints no table.

    Raises:
        InputError: a run is damaged, or the runs cannot share a table.
    """
    results = read_results(outputs)
    tables = write_tables(outputs.tables, results)
    print(*answer(results), sep="\n")
    effect = decay_table(results)
    for name in TABLES if names and effect.rows else names:
        print("\n" + tables[name].to_markdown())
    if names and effect.rows:
        print(effect.to_markdown())
    if names and (note := not_shown(results)):
        print(note)
    print(f"Tables: {outputs.tables}", flush=True)
