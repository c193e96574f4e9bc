"""Figures of the analysis: frames in, `Figure` out. All are readable in gray; CSV files beside them hold their data."""

from collections.abc import Callable, Collection
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.evaluation.breakdown import HITS
from repro.evaluation.recency import RECENCY
from repro.reporting.comparison_figures import baselines, encodings, generalization
from repro.reporting.names import experiment_title
from repro.reporting.plots import LOOKS, STYLE, DataFrames, columns, marks, one_legend, save_or_delete

DECAYS = {PROJECTION: (LOOKS[0], "with time decay"), PROJECTION_NO_DECAY: (LOOKS[1], "without time decay")}


def write_analysis_figures(
    directory: Path,
    frames: DataFrames,
    names: Collection[str] | None = None,
    suffixes: tuple[str, ...] = ("png", "pdf"),
) -> list[Path]:
    """Write every figure that has data, or those of `names`, and delete those without; return the PNG files."""
    chosen = {name: draw for name, draw in FIGURES.items() if names is None or name in names}
    with plt.rc_context(STYLE):
        written = [save_or_delete(draw(frames), directory / name, suffixes) for name, draw in chosen.items()]
    return [path for path in written if path]


def recency(frames: DataFrames) -> Figure | None:
    """Plot obstacle recall and Brier score of U-Net by recency, with occluded and never in view; None without data."""
    rows = _unet(frames["recency"])
    names = [name for name in RECENCY if name in set(rows["recency"])]
    if not names:
        return None
    measures = {"obstacle_recall": "obstacle recall", "brier": "Brier score"}
    figure, axes = columns(rows, len(measures), sharey="row", sharex=True)
    for column, (experiment, own_rows) in zip(axes.T, rows.groupby("experiment"), strict=True):
        for ax, metric in zip(column, measures, strict=True):
            measured = own_rows[own_rows["metric"] == metric]
            kinds = {label: measured[measured["encoding"] == name] for name, (_, label) in DECAYS.items()}
            marks(ax, {label: kind.set_index("recency") for label, kind in kinds.items()}, names)
        column[0].set_title(experiment_title(str(experiment), "\n{}"))
        column[-1].tick_params("x", rotation=40)
        column[-1].set_xlabel("time since last seen [steps]")
    for ax, label in zip(axes[:, 0], measures.values(), strict=True):
        ax.set_ylim(bottom=0)
        ax.set_ylabel(label)
    one_legend(figure, axes[0])
    return figure


def obstacles(frames: DataFrames) -> Figure | None:
    """Plot the recall of single obstacles by time since last hit: U-Net, ablation, baselines; None without data."""
    table = frames["obstacles"]
    rows = table[table["metric"] == "recall"]
    kinds = {
        "U-Net": rows[(rows["model"] == "unet") & (rows["encoding"] == PROJECTION)],
        "U-Net, no decay": rows[(rows["model"] == "unet") & (rows["encoding"] == PROJECTION_NO_DECAY)],
        "Tracker": rows[rows["model"] == "tracker"],
        "Last seen": rows[rows["model"] == "last_seen"],
    }
    if kinds["U-Net"].empty:
        return None
    figure, axes = columns(kinds["U-Net"], 1, sharey=True)
    for ax, experiment in zip(axes[0], sorted(kinds["U-Net"]["experiment"].unique()), strict=True):
        by_kind = {label: kind[kind["experiment"] == experiment].set_index("last_hit") for label, kind in kinds.items()}
        marks(ax, by_kind, list(HITS))
        ax.set(title=experiment_title(str(experiment), "\n{}"), ylim=(0, 1), xlabel="time since last hit [steps]")
    axes[0, 0].set_ylabel("recall of an obstacle")
    one_legend(figure, axes[0])
    return figure


def reliability(frames: DataFrames) -> Figure | None:
    """Plot the reliability diagram of U-Net; None without data."""
    rows = _unet(frames["reliability"])
    rows = rows[rows["recency"] == "all"] if len(rows) else rows
    if rows.empty:
        return None
    figure, axes = columns(rows, 1, sharey=True)
    for ax, (experiment, own_rows) in zip(axes[0], rows.groupby("experiment"), strict=True):
        ax.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=1)
        for encoding, line in own_rows.groupby("encoding", sort=False):
            look, label = DECAYS[str(encoding)]
            ax.plot(line["predicted"], line["found"], markersize=3, label=label, **look)
        ax.set(title=experiment_title(str(experiment), "\n{}"), xlabel="predicted probability", aspect="equal")
    axes[0, 0].set_ylabel("observed frequency")
    one_legend(figure, axes[0])
    return figure


FIGURES: dict[str, Callable[[DataFrames], Figure | None]] = {
    "recency": recency,
    "obstacles": obstacles,
    "reliability": reliability,
    "baselines": baselines,
    "encodings": encodings,
    "generalization": generalization,
}


def _unet(table: pd.DataFrame) -> pd.DataFrame:
    return table[(table["model"] == "unet") & table["encoding"].isin(list(DECAYS))]
