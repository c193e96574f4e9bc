"""Figures of the analysis: frames in, `Figure` out. All are readable in gray; CSV files beside them hold their data."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from repro.baselines.titles import rank
from repro.evaluation.breakdown import HITS
from repro.evaluation.recency import RECENCY
from repro.reporting.names import predictor_title
from repro.reporting.plots import (
    ACCENT,
    INK,
    LOOKS,
    STYLE,
    DataFrames,
    columns,
    marks,
    one_legend,
    panels,
    save_or_delete,
)
from repro.reporting.tables import OURS
from repro.runs.config import NO_DECAY, PROJECTION, PROJECTION_NO_DECAY, RECURRENT

NETWORK_DOT: dict[str, Any] = {"color": ACCENT, "marker": "o"}
BASELINE_DOT: dict[str, Any] = {"color": INK, "marker": "s", "markerfacecolor": "white"}
DECAYS = {PROJECTION: (LOOKS[0], "with time decay"), PROJECTION_NO_DECAY: (LOOKS[1], "without time decay")}


def write_analysis_figures(directory: Path, frames: DataFrames) -> None:
    """Write every figure that has data, as PNG and PDF, and delete those without."""
    with plt.rc_context(STYLE):
        for name, draw in FIGURES.items():
            save_or_delete(draw(frames), directory / name)


def recency(frames: DataFrames) -> Figure | None:
    """Plot obstacle recall and Brier score of U-Net by recency, with occluded and never in view; None without data."""
    rows = _unet(frames["recency"])
    names = [name for name in RECENCY if name in set(rows["recency"])]
    if not names:
        return None
    measures = {"obstacle_recall": "obstacle recall", "brier": "Brier score"}
    figure, axes = columns(rows, len(measures), sharey="row", sharex=True)
    for line, (metric, title) in zip(axes, measures.items(), strict=True):
        for ax, own_rows in panels(line, rows[rows["metric"] == metric].set_index("recency")):
            marks(ax, {label: own_rows[own_rows["encoding"] == name] for name, (_, label) in DECAYS.items()}, names)
        line[0].set_ylim(bottom=0)
        line[0].set_ylabel(title)
    for ax in axes[1:].flat:
        ax.set_title("")
    for ax in axes[-1]:
        plt.setp(ax.get_xticklabels(), rotation=40, ha="right", rotation_mode="anchor")
        ax.set_xlabel("time since last seen [steps]")
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
    for ax, own_rows in panels(axes[0], kinds["U-Net"]):
        experiment = own_rows["experiment"].iloc[0]
        by_kind = {label: kind[kind["experiment"] == experiment].set_index("last_hit") for label, kind in kinds.items()}
        marks(ax, by_kind, [*HITS])
        ax.set(ylim=(0, 1), xlabel="time since last hit [steps]")
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
    for ax, own_rows in panels(axes[0], rows):
        ax.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=1)
        for encoding, line in own_rows.groupby("encoding", sort=False):
            look, label = DECAYS[str(encoding)]
            ax.plot(line["predicted"], line["observed"], markersize=3, label=label, **look)
        ax.set(xlabel="predicted probability", aspect="equal")
    axes[0, 0].set_ylabel("observed frequency")
    one_legend(figure, axes[0])
    return figure


def baselines(frames: DataFrames) -> Figure | None:
    """Plot the obstacle IoU of networks on the paper's input, of recurrent ones, of our best input, and of baselines.

    A dot with its interval for each predictor, from the bottom up, one column per experiment; networks are filled. None
    with fewer than two predictors.
    """
    table = frames["intervals"]
    rows = table[(table["metric"] == "obstacle_iou") & ~table["encoding"].str.endswith(NO_DECAY)]
    shown = rows["encoding"].isin(["", PROJECTION, OURS[1]]) | rows["model"].isin(RECURRENT)
    rows = rows[shown & ~rows["model"].isin(["average", "all_free", "inference"])]
    titles = [predictor_title(*cell) for cell in zip(rows["model"], rows["encoding"], strict=True)]
    rows = rows.assign(title=titles, rank=rows["model"].map(rank))
    names = rows.drop_duplicates("title").sort_values(["rank", "encoding", "model"], ascending=False)["title"].tolist()
    if len(names) < 2:
        return None
    figure, axes = columns(rows, 1, sharey=True)
    figure.set_size_inches(1.6 + 2.3 * axes.shape[1], 0.9 + 0.26 * len(names))
    row: Any
    for ax, own_rows in panels(axes[0], rows):
        for row in own_rows.itertuples():
            form = NETWORK_DOT if row.encoding else BASELINE_DOT
            spread = [[row.value - row.low], [row.high - row.value]]
            ax.errorbar(row.value, names.index(row.title), xerr=spread, markersize=4, capsize=2, **form)
        ax.set_xlabel("obstacle IoU")
        ax.grid(axis="x", color="#dddddd", linewidth=0.5)
        ax.set_yticks(range(len(names)), names)
    return figure


def _unet(table: pd.DataFrame) -> pd.DataFrame:
    return table[(table["model"] == "unet") & table["encoding"].isin(list(DECAYS))]


FIGURES: dict[str, Callable[[DataFrames], Figure | None]] = {
    "recency": recency,
    "obstacles": obstacles,
    "reliability": reliability,
    "baselines": baselines,
}
