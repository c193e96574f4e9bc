"""Comparison figures: networks, inputs and baselines; generalization."""

import math
from itertools import cycle

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from repro.baselines.names import OTHER_BOUNDS, rank
from repro.config import NO_DECAY, PROJECTION, RECURRENT
from repro.reporting.names import experiment_title, predictor_title, tested_titles
from repro.reporting.plots import ACCENT, INK, LOOKS, DataFrames, one_legend
from repro.reporting.results import OURS


def baselines(frames: DataFrames) -> Figure | None:
    """Plot the obstacle IoU of all networks on the paper's input, our best input and the baselines, or None."""
    rows = titled(frames["intervals"])
    shown = rows["encoding"].isin(["", PROJECTION]) | rows["model"].isin(RECURRENT) | (rows["encoding"] == OURS[1])
    rows = rows[shown & ~rows["model"].isin(["average", "all_free", *OTHER_BOUNDS])]
    names = rows.drop_duplicates("title").sort_values(["rank", "encoding", "model"], ascending=False)["title"].tolist()
    return _dots(rows, names) if len(names) > 1 else None


def encodings(frames: DataFrames) -> Figure | None:
    """Plot the obstacle IoU of U-Net on every encoding, and of a sequence network, with intervals, or None."""
    rows = titled(frames["intervals"])
    rows = rows[rows["model"].isin(["unet", *RECURRENT])]
    inputs = rows.groupby("experiment")["encoding"].nunique()
    rows = rows[rows["experiment"].isin(inputs.index[inputs == inputs.max()])]  # the experiments with most encodings
    names = rows.drop_duplicates("title").sort_values(["rank", "encoding", "model"], ascending=False)["title"].tolist()
    return _dots(rows, names) if len(names) > 1 else None


def generalization(frames: DataFrames) -> Figure | None:
    """Plot the obstacle IoU of networks under changed sensors, poses and speeds; None without data."""
    if "generalization" not in frames:
        return None
    rows = frames["generalization"]
    rows = rows[(rows["shift"] != "experiment") & (rows["metric"] == "obstacle_iou")]
    if rows.empty:
        return None
    rows = rows.assign(title=tested_titles(rows))
    shifts, names = (list(dict.fromkeys(rows[column])) for column in ("shift", "title"))
    down = 1 if len(shifts) <= 4 else 2
    across = math.ceil(len(shifts) / down)
    size = (0.6 + 2.2 * across, 0.4 + 2.2 * down)
    figure, axes = plt.subplots(down, across, figsize=size, layout="constrained", sharey=True, squeeze=False)
    for ax, shift in zip(axes.flat, shifts, strict=False):
        chosen = rows[rows["shift"] == shift]
        for name, look in zip(names, cycle(LOOKS), strict=False):
            line = chosen[chosen["title"] == name]
            spread = [line["value"] - line["low"], line["high"] - line["value"]]
            amount = line["tested"].astype(float)
            ax.errorbar(amount, line["value"], yerr=spread, markersize=3, capsize=2, label=name, **look)
        ax.set(xlabel=shift)
    for ax in axes[:, 0]:
        ax.set_ylabel("obstacle IoU")
    axes[0, 0].set_ylim(bottom=0)
    for ax in list(axes.flat)[len(shifts) :]:
        ax.set_axis_off()
    if len(names) > 1:
        one_legend(figure, axes[0], rows=1)
    return figure


def titled(table: pd.DataFrame) -> pd.DataFrame:
    """Select the obstacle IoU of all cells with decay; add the title and the rank of each predictor."""
    rows = table[(table["metric"] == "obstacle_iou") & ~table["encoding"].str.endswith(NO_DECAY)]
    titles = [predictor_title(*cell) for cell in zip(rows["model"], rows["encoding"], strict=True)]
    return rows.assign(title=titles, rank=rows["model"].map(rank))


def _dots(rows: pd.DataFrame, names: list[str]) -> Figure:
    """Draw a dot with its interval for each title, from the bottom up, one column per experiment; networks filled."""
    experiments = sorted(rows["experiment"].unique())
    size = (1.6 + 2.3 * len(experiments), 0.9 + 0.26 * len(names))
    figure, axes = plt.subplots(1, len(experiments), figsize=size, layout="constrained", squeeze=False, sharey=True)
    for ax, experiment in zip(axes[0], experiments, strict=True):
        for row in rows[rows["experiment"] == experiment].itertuples():
            is_network = row.encoding != ""
            form = {
                "color": ACCENT if is_network else INK,
                "marker": "o" if is_network else "s",
                "markersize": 4,
                "capsize": 2,
            }
            spread = [[row.value - row.low], [row.high - row.value]]
            ax.errorbar(
                row.value, names.index(row.title), xerr=spread, markerfacecolor=None if is_network else "white", **form
            )
        ax.set(title=experiment_title(str(experiment), "\n{}"), xlabel="obstacle IoU")
        ax.grid(axis="x", color="#dddddd", linewidth=0.5)
        ax.set_yticks(range(len(names)), names)
    return figure
