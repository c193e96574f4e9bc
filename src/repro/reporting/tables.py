"""Tables: a frame and its caption, as CSV, Markdown and LaTeX."""

import re
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from repro.config import NO_DECAY, PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import HEADINGS, TABLE_METRICS
from repro.reporting.captions import caption, missing
from repro.reporting.markdown import markdown_table
from repro.reporting.names import experiment_title, predictor_title
from repro.reporting.results import OURS, compare, read_results, select
from repro.runs.outputs import Outputs
from repro.system.files import write_text

HEADS = {name: HEADINGS.get(name, name) for name in TABLE_METRICS}
TABLE_TITLES = {
    "main": "Prediction metrics across all four experiments for all models",
    "ablation": "Prediction metrics without the gray-scale time decay",
}
TABLE_ENCODINGS = {"main": PROJECTION, "ablation": PROJECTION_NO_DECAY}  # encoding of the networks in each table
COSTS = {
    "model": "Model",
    "size_px": "Image [px]",
    "parameters_m": "Parameters [M]",
    "forward_gflop": "Forward [GFLOP]",
    "training_min": "Training [min]",
    "cpu_eager_ms": "CPU, eager [ms]",
    "cpu_onnx_ms": "CPU, ONNX Runtime [ms]",
    "cuda_eager_ms": "GPU, eager [ms]",
}


COST_DIGITS = {"size_px": 0, "parameters_m": 2, "forward_gflop": 2}  # decimals; all others have one


@dataclass(frozen=True)
class Table:
    """Rows with named columns, and their caption; empty if no run is evaluated. The note is for the terminal."""

    frame: pd.DataFrame
    caption: str
    note: str = ""

    def to_markdown(self) -> str:
        """Return the table as Markdown, one row per model: our number, and the paper's in brackets."""
        if self.frame.empty:
            return f"**{self.caption}**\n"
        rows = []
        for _, row in self.frame.iterrows():
            cells = [_ours(row, metric, 3) + _paper(row, metric, " ({:.3f})") for metric in TABLE_METRICS]
            rows.append((row["experiment"], row_title(row), *cells))
        lines = markdown_table(("Exp.", "Model", *HEADS.values()), rows)
        return "\n".join([f"**{self.caption}** Ours (paper).", "", *lines]) + "\n"

    def to_latex(self) -> str:
        """Return the table as LaTeX (booktabs) in the paper's layout, two experiments side by side."""
        experiments = self.frame["experiment"].unique().tolist()
        blocks = [self._latex_block(experiments[first : first + 2]) for first in range(0, len(experiments), 2)]
        body = " \\midrule\n".join(blocks)
        return (
            "\\begin{table*}\n\\centering\n"
            f"\\caption{{{_escape(self.caption)}}}\n"
            f"\\begin{{tabular}}{{@{{}}l*{{{2 * len(TABLE_METRICS)}}}{{l}}@{{}}}}\n\\toprule\n"
            f"{body} \\bottomrule\n"
            "\\end{tabular}\n\\end{table*}\n"
        )

    def write(self, directory: Path, name: str) -> None:
        """Write <name>.csv, <name>.md and <name>.tex to a directory."""
        write_text(directory / f"{name}.csv", self.frame.to_csv(index=False, float_format="%.4f"))
        write_text(directory / f"{name}.md", self.to_markdown())
        write_text(directory / f"{name}.tex", self.to_latex())

    def _latex_block(self, experiments: list[str]) -> str:
        frame = self.frame[self.frame["experiment"].isin(experiments)]
        titles = frame.apply(row_title, axis="columns")
        halves = [frame[frame["experiment"] == experiment] for experiment in experiments]
        halves = [half.set_index(titles[half.index]) for half in halves]
        halves += [halves[0].iloc[:0]] * (2 - len(halves))
        over = [_escape(experiment_title(experiment, " ({})")) for experiment in experiments]
        heads = [rf"\multicolumn{{{len(TABLE_METRICS)}}}{{c}}{{{head}}}" for head in over]
        lines = [
            " & " + " & ".join(heads) + r" \\",
            " & ".join(["Model", *HEADS.values(), *HEADS.values()]) + r" \\ \midrule",
        ]
        for title in titles.unique():
            rows = [half.loc[title] if title in half.index else None for half in halves]
            ours = [_ours(row, metric, 4) if row is not None else "" for row in rows for metric in TABLE_METRICS]
            lines.append(" & ".join([_escape(title), *ours]) + r" \\")
            paper = [
                _paper(row, metric, "{:.4f}") if row is not None else "" for row in rows for metric in TABLE_METRICS
            ]
            if any(paper):
                lines.append(" & ".join([r"\quad\emph{paper}", *paper]) + r" \\")
        return "\n".join(lines)


def row_title(row: pd.Series) -> str:
    """Return the title of a row: its model, and its encoding unless it is that of the table."""
    encoding = str(row["encoding"])
    mark = " (ours)" if (row["model"], encoding) == OURS else ""
    return predictor_title(row["model"], encoding.removesuffix(NO_DECAY)) + mark


def make_tables(results: pd.DataFrame) -> dict[str, Table]:
    """Create the main table and the ablation from tidy rows; a table without rows is empty."""
    tables = {}
    for name, encoding in TABLE_ENCODINGS.items():
        rows = select(results, encoding) if len(results) else results
        note = _not_shown(results) if name == "main" else ""
        if rows.empty:
            tables[name] = Table(pd.DataFrame(), f"{TABLE_TITLES[name]}. No run evaluated yet.", note)
        else:
            facts = caption(rows) + missing(rows, encoding)
            tables[name] = Table(compare(results, encoding), f"{TABLE_TITLES[name]}. {facts}", note)
    return tables


def _not_shown(results: pd.DataFrame) -> str:
    """Count the evaluated networks and inputs that are in neither table; empty if none."""
    if results.empty:
        return ""
    shown = pd.concat([select(results, encoding) for encoding in TABLE_ENCODINGS.values()]).index
    others = results[(results["encoding"] != "") & ~results.index.isin(shown)]
    titles = list(dict.fromkeys(map(predictor_title, others["model"], others["encoding"])))
    if not titles:
        return ""
    more = f" and {len(titles) - 1} more networks and inputs" if titles[1:] else ""
    return f"Evaluated, but in the tables of task=analysis only: {titles[0]}{more}."


def write_tables(outputs: Outputs, errors: list[str] | None = None) -> dict[str, Table]:
    """Write the main table and the ablation of all evaluated runs to outputs/tables; see `read_results`."""
    tables = make_tables(read_results(outputs, errors))
    outputs.tables.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        if len(table.frame):
            table.write(outputs.tables, name)
        else:  # the runs of an earlier table have been deleted
            for path in outputs.tables.glob(f"{name}.*"):
                path.unlink()
    return tables


def costs_to_markdown(costs: Table) -> str:
    """Return the costs as Markdown, one row per network and resolution, without columns that are empty everywhere."""
    titles = costs.frame.apply(_title, axis="columns")
    frame = costs.frame.drop(columns="encoding", errors="ignore").assign(model=titles).dropna(axis="columns", how="all")
    rows = [[_cost(str(name), value) for name, value in row.items()] for _, row in frame.iterrows()]
    return "\n".join([f"**{costs.caption}**", "", *markdown_table((COSTS[str(name)] for name in frame), rows)]) + "\n"


def _escape(text: str) -> str:
    """Return text for LaTeX, which gives these characters a meaning."""
    return re.sub(r"([&%$#_{}])", r"\\\1", text)


def _title(row: pd.Series) -> str:
    return predictor_title(row["model"], row.get("encoding", PROJECTION))


def _cost(name: str, value: float | str) -> str:
    if isinstance(value, str):
        return value
    return "" if pd.isna(value) else f"{value:.{COST_DIGITS.get(name, 1)}f}"


def _ours(row: pd.Series, metric: str, digits: int) -> str:
    if pd.isna(row.get(metric)):  # a metric that is younger than these results
        return ""
    spread = row.get(f"std_{metric}")
    return f"{row[metric]:.{digits}f}" + (f" ± {spread:.{digits}f}" if spread is not None and pd.notna(spread) else "")


def _paper(row: pd.Series, metric: str, form: str) -> str:
    value = row.get(f"paper_{metric}")
    return form.format(value) if pd.notna(value) else ""
