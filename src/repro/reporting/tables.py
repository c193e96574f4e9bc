"""The two tables as CSV, Markdown and LaTeX."""

from pathlib import Path

import pandas as pd

from repro.evaluation.metrics import METRICS
from repro.reporting.results import caption, compare, read_results

NAMES = {
    "unet": "U-Net",
    "fpn": "FPN",
    "upernet": "UPerNet",
    "segformer": "Segformer",
    "average": "Average",
    "all_free": "All free",
    "last_seen": "Last seen",
}
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
SETUPS = {"1": "Static, rotation", "2": "Static, square", "3": "Dynamic, rotation", "4": "Dynamic, square"}


def write_tables(outputs: Path) -> dict[str, str]:
    """Writes main and ablation tables below outputs/tables from whatever runs there are.

    Args:
        outputs: the outputs directory of one scale, named after it.

    Returns:
        both tables as Markdown, by name.
    """
    results = read_results(outputs)
    directory = outputs / "tables"
    directory.mkdir(parents=True, exist_ok=True)
    pages = {}
    for name, decay in (("main", True), ("ablation", False)):
        rows = results[results["decay"] == decay] if len(results) else results
        if rows.empty:
            pages[name] = f"**{TITLES[name]}.** No run evaluated yet.\n"
            continue
        table, note = compare(results, decay=decay), f"{TITLES[name]}. {caption(rows, outputs.name)}"
        table.to_csv(directory / f"{name}.csv", index=False, float_format="%.4f")
        pages[name] = to_markdown(table, note)
        (directory / f"{name}.md").write_text(pages[name])
        (directory / f"{name}.tex").write_text(to_latex(table, note))
    return pages


def to_markdown(table: pd.DataFrame, note: str) -> str:
    """One row a model: our number, and the paper's in brackets."""
    head = "| Exp. | Model | " + " | ".join(HEADS.values()) + " |"
    lines = [f"**{note}** Ours (paper).", "", head, "|---|---|" + "---|" * len(METRICS)]
    for _, row in table.iterrows():
        cells = [_ours(row, metric, 3) + _paper(row, metric, " ({:.3f})") for metric in METRICS]
        lines.append(f"| {row['experiment']} | {NAMES[row['model']]} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def costs_to_markdown(table: pd.DataFrame, note: str) -> str:
    """One row a network and resolution; what was measured nowhere is left out."""
    table = table.dropna(axis="columns", how="all")
    lines = [
        f"**{note}**",
        "",
        "| " + " | ".join(COSTS[str(name)] for name in table) + " |",
        "|" + "---|" * table.shape[1],
    ]
    for _, row in table.iterrows():
        cells = [NAMES[value] if isinstance(value, str) else "" if pd.isna(value) else f"{value:.3g}" for value in row]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def to_latex(table: pd.DataFrame, note: str) -> str:
    """The paper's layout in booktabs: two experiments side by side, under each of our rows the paper's."""
    blocks = []
    for left, right in (("1", "2"), ("3", "4")):
        halves = [table[table["experiment"] == experiment].set_index("model") for experiment in (left, right)]
        if all(half.empty for half in halves):
            continue
        heads = " & ".join(rf"\multicolumn{{6}}{{c}}{{Experiment {e} ({SETUPS[e]})}}" for e in (left, right))
        lines = [rf" & {heads} \\", " & ".join(["Model", *HEADS.values(), *HEADS.values()]) + r" \\ \midrule"]
        for model in table["model"].unique():
            rows = [half.loc[model] if model in half.index else None for half in halves]
            ours = [_ours(row, metric, 4) if row is not None else "" for row in rows for metric in METRICS]
            lines.append(" & ".join([NAMES[model], *ours]) + r" \\")
            paper = [_paper(row, metric, "{:.4f}") if row is not None else "" for row in rows for metric in METRICS]
            if any(paper):
                lines.append(" & ".join([r"\quad\emph{paper}", *paper]) + r" \\")
        blocks.append("\n".join(lines))
    body = " \\midrule\n".join(blocks)
    note = note.replace("_", r"\_")
    return (
        "\\begin{table*}\n\\centering\n"
        f"\\caption{{{note}}}\n"
        "\\begin{tabular}{@{}l*{12}{l}@{}}\n\\toprule\n"
        f"{body} \\bottomrule\n"
        "\\end{tabular}\n\\end{table*}\n"
    )


def _ours(row: pd.Series, metric: str, digits: int) -> str:
    spread = row.get(f"std_{metric}")
    return f"{row[metric]:.{digits}f}" + (f" ± {spread:.{digits}f}" if spread is not None and pd.notna(spread) else "")


def _paper(row: pd.Series, metric: str, form: str) -> str:
    value = row[f"paper_{metric}"]
    return form.format(value) if pd.notna(value) else ""
