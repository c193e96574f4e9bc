"""Figures of the analysis: frames in, `Figure` out. Each can be read in gray, and has its rows beside it as CSV."""

from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.evaluation.recency import RECENCY
from repro.reporting.comparison_figures import baselines, curves, encodings, generalization
from repro.reporting.figures import STYLE
from repro.reporting.names import experiment_title
from repro.reporting.plots import LOOKS, Frames, columns, marks, one_legend

DECAYS = {PROJECTION: (LOOKS[0], "with time decay"), PROJECTION_NO_DECAY: (LOOKS[1], "without")}
HITS = ("1-10", "11-25", "26-50", "51-100", "never")


def write_analysis_figures(directory: Path, frames: Frames) -> list[Path]:
    """Draws every figure for which there are rows, as PNG and PDF; returns the PNG files."""
    written = []
    with plt.rc_context(STYLE):
        for name, draw in FIGURES.items():
            figure = draw(frames)
            if figure is None:
                continue
            for suffix in ("png", "pdf"):
                figure.savefig(directory / f"{name}.{suffix}", bbox_inches="tight", pad_inches=0.05)
            plt.close(figure)
            written.append(directory / f"{name}.png")
    return written


def ages(frames: Frames) -> Figure | None:
    """Shows what U-Net finds, and how sure it is, by how long ago the lidar last saw a pixel."""
    rows = _unet(frames["ages"])
    if rows.empty:
        return None
    measures = {"obstacle_recall": "obstacle pixels found", "entropy": "entropy [nat]"}
    figure, axes = columns(rows, len(measures), sharey="row")
    for column, (experiment, mine) in zip(axes.T, rows.groupby("experiment"), strict=True):
        for ax, metric in zip(column, measures, strict=True):
            for encoding, line in mine[mine["metric"] == metric].groupby("encoding", sort=False):
                look, label = DECAYS[str(encoding)]
                ax.plot(line["age"], line["value"], markersize=3, label=label, **look)
        column[0].set_title(experiment_title(str(experiment), "\n{}"))
        column[-1].set_xlabel("last seen before the end [steps]")
    for ax, label in zip(axes[:, 0], measures.values(), strict=True):
        ax.set_ylim(bottom=0)  # for all of its row
        ax.set_ylabel(label)
    one_legend(figure, axes[0])
    return figure


def recency(frames: Frames) -> Figure | None:
    """Shows what U-Net finds, and how far off it is, by when a pixel was last inside the visible region."""
    rows = _unet(frames["recency"])
    names = [name for name in RECENCY if name in set(rows["recency"])]
    if not names:
        return None
    measures = {"obstacle_recall": "obstacle pixels found", "brier": "Brier score"}
    figure, axes = columns(rows, len(measures), sharey="row", sharex=True)
    for column, (experiment, mine) in zip(axes.T, rows.groupby("experiment"), strict=True):
        for ax, metric in zip(column, measures, strict=True):
            measured = mine[mine["metric"] == metric]
            kinds = {label: measured[measured["encoding"] == name] for name, (_, label) in DECAYS.items()}
            marks(ax, {label: kind.set_index("recency") for label, kind in kinds.items()}, names)
        column[0].set_title(experiment_title(str(experiment), "\n{}"))
        column[-1].tick_params("x", rotation=40)
        column[-1].set_xlabel("last visible [steps ago]")
    for ax, label in zip(axes[:, 0], measures.values(), strict=True):
        ax.set_ylim(bottom=0)
        ax.set_ylabel(label)
    one_legend(figure, axes[0])
    return figure


def obstacles(frames: Frames) -> Figure | None:
    """Shows how much of an obstacle is found, by when it was last hit: U-Net, without decay, and the tracker."""
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
        mine = {label: kind[kind["experiment"] == experiment].set_index("last_hit") for label, kind in kinds.items()}
        marks(ax, mine, list(HITS))
        ax.set(title=experiment_title(str(experiment), "\n{}"), ylim=(0, 1), xlabel="last hit before the end [steps]")
    axes[0, 0].set_ylabel("share of the obstacle found")
    one_legend(figure, axes[0])
    return figure


def reliability(frames: Frames) -> Figure | None:
    """Shows how often what U-Net predicts comes true."""
    rows = _unet(frames["reliability"])
    rows = rows[rows["recency"] == "all"] if len(rows) else rows
    if rows.empty:
        return None
    figure, axes = columns(rows, 1, sharey=True)
    for ax, (experiment, mine) in zip(axes[0], rows.groupby("experiment"), strict=True):
        ax.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=1)
        for encoding, line in mine.groupby("encoding", sort=False):
            look, label = DECAYS[str(encoding)]
            ax.plot(line["predicted"], line["found"], markersize=3, label=label, **look)
        ax.set(title=experiment_title(str(experiment), "\n{}"), xlabel="predicted probability", aspect="equal")
    axes[0, 0].set_ylabel("share that are obstacles")
    one_legend(figure, axes[0])
    return figure


FIGURES: dict[str, Callable[[Frames], Figure | None]] = {
    "recency": recency,
    "ages": ages,
    "obstacles": obstacles,
    "reliability": reliability,
    "baselines": baselines,
    "encodings": encodings,
    "generalization": generalization,
    "curves": curves,
}


def _unet(table: pd.DataFrame) -> pd.DataFrame:
    return table[(table["model"] == "unet") & table["encoding"].isin(list(DECAYS))]
