"""Tables: a frame and its caption, as CSV, Markdown and LaTeX."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from repro.evaluation.metrics import METRICS
from repro.files import write_text
from repro.names import NAMES, experiment_title
from repro.reporting.results import caption, compare, read_results
from repro.runs import Outputs

HEADS = dict(zip(METRICS, ("SSIM", "Acc.", "Dice", "Prec.", "Recall", "Spec."), strict=True))
TITLES = {
    "main": "Prediction metrics across all four experiments for all models",
    "ablation": "Prediction metrics without the gray-scale time decay",
}
COSTS = {
    "model": "Model",
    "size_px": "Image [px]",
    "parameters_m": "Parameters [M]",
    "forward_gflop": "Forward [GFLOP]",
    "training_min": "Training [min]",
    "training_gpu_gb": "Training memory on GPU [GB]",
    "cpu_eager_ms": "CPU, eager [ms]",
    "cpu_compiled_ms": "CPU, compiled [ms]",
    "cpu_onnx_ms": "CPU, ONNX Runtime [ms]",
    "cuda_eager_ms": "GPU, eager [ms]",
    "cuda_compiled_ms": "GPU, compiled [ms]",
}


@dataclass(frozen=True)
class Table:
    """Rows with named columns, and the words above them. Empty when nothing has been evaluated yet."""

    frame: pd.DataFrame
    caption: str

    def to_markdown(self) -> str:
        """Writes one row a model: our number, and the paper's in brackets."""
        if self.frame.empty:
            return f"**{self.caption}**\n"
        head = "| Exp. | Model | " + " | ".join(HEADS.values()) + " |"
        lines = [f"**{self.caption}** Ours (paper).", "", head, "|---|---|" + "---|" * len(METRICS)]
        for _, row in self.frame.iterrows():
            cells = [_ours(row, metric, 3) + _paper(row, metric, " ({:.3f})") for metric in METRICS]
            lines.append(f"| {row['experiment']} | {NAMES[row['model']]} | " + " | ".join(cells) + " |")
        return "\n".join(lines) + "\n"

    def to_latex(self) -> str:
        """Writes the paper's layout in booktabs: two experiments side by side, under each of our rows the paper's."""
        experiments = self.frame["experiment"].unique().tolist()
        blocks = [self._latex_block(experiments[first : first + 2]) for first in range(0, len(experiments), 2)]
        body = " \\midrule\n".join(blocks)
        note = self.caption.replace("_", r"\_")
        return (
            "\\begin{table*}\n\\centering\n"
            f"\\caption{{{note}}}\n"
            "\\begin{tabular}{@{}l*{12}{l}@{}}\n\\toprule\n"
            f"{body} \\bottomrule\n"
            "\\end{tabular}\n\\end{table*}\n"
        )

    def write(self, directory: Path, name: str) -> None:
        """Writes <name>.csv, .md and .tex into a directory."""
        write_text(directory / f"{name}.csv", self.frame.to_csv(index=False, float_format="%.4f"))
        write_text(directory / f"{name}.md", self.to_markdown())
        write_text(directory / f"{name}.tex", self.to_latex())

    def _latex_block(self, experiments: list[str]) -> str:
        frame = self.frame[self.frame["experiment"].isin(experiments)]
        halves = [frame[frame["experiment"] == experiment].set_index("model") for experiment in experiments]
        halves += [halves[0].iloc[:0]] * (2 - len(halves))
        heads = [rf"\multicolumn{{6}}{{c}}{{{experiment_title(e, ' ({})')}}}" for e in experiments]
        lines = [
            " & " + " & ".join(heads) + r" \\",
            " & ".join(["Model", *HEADS.values(), *HEADS.values()]) + r" \\ \midrule",
        ]
        for model in frame["model"].unique():
            rows = [half.loc[model] if model in half.index else None for half in halves]
            ours = [_ours(row, metric, 4) if row is not None else "" for row in rows for metric in METRICS]
            lines.append(" & ".join([NAMES[model], *ours]) + r" \\")
            paper = [_paper(row, metric, "{:.4f}") if row is not None else "" for row in rows for metric in METRICS]
            if any(paper):
                lines.append(" & ".join([r"\quad\emph{paper}", *paper]) + r" \\")
        return "\n".join(lines)


def make_tables(results: pd.DataFrame) -> dict[str, Table]:
    """Makes the main table and the ablation from tidy rows, an empty one where there are none."""
    tables = {}
    for name, decay in (("main", True), ("ablation", False)):
        rows = results[results["decay"] == decay] if len(results) else results
        if rows.empty:
            tables[name] = Table(pd.DataFrame(), f"{TITLES[name]}. No run evaluated yet.")
        else:
            tables[name] = Table(compare(results, decay=decay), f"{TITLES[name]}. {caption(rows)}")
    return tables


def write_tables(outputs: Outputs, faults: list[str] | None = None) -> dict[str, Table]:
    """Writes main table and ablation below outputs/tables from whatever runs there are; see `read_results`."""
    tables = make_tables(read_results(outputs, faults))
    outputs.tables.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        if len(table.frame):
            table.write(outputs.tables, name)
    return tables


def costs_to_markdown(table: Table) -> str:
    """Writes one row a network and resolution; what was measured nowhere is left out."""
    frame = table.frame.dropna(axis="columns", how="all")
    lines = [
        f"**{table.caption}**",
        "",
        "| " + " | ".join(COSTS[str(name)] for name in frame) + " |",
        "|" + "---|" * frame.shape[1],
    ]
    for _, row in frame.iterrows():
        cells = [NAMES[value] if isinstance(value, str) else "" if pd.isna(value) else f"{value:.3g}" for value in row]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _ours(row: pd.Series, metric: str, digits: int) -> str:
    spread = row.get(f"std_{metric}")
    return f"{row[metric]:.{digits}f}" + (f" ± {spread:.{digits}f}" if spread is not None and pd.notna(spread) else "")


def _paper(row: pd.Series, metric: str, form: str) -> str:
    value = row[f"paper_{metric}"]
    return form.format(value) if pd.notna(value) else ""
