"""Figures of the evidence: frames in, `Figure` out. Each can be read in gray, and has its rows beside it as CSV."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from repro.config import LEARNED
from repro.evaluation.strata import STRATA
from repro.maps.encodings import ENCODINGS
from repro.names import NAMES, experiment_title, predictor_title
from repro.reporting.figures import ACCENT, INK, STYLE
from repro.reporting.results import OURS

Frames = dict[str, pd.DataFrame]
LOOKS: list[dict[str, Any]] = [  # told apart by mark and line, not by colour alone
    {"color": ACCENT, "marker": "o", "linestyle": "-"},
    {"color": "#d1711a", "marker": "s", "linestyle": "--"},
    {"color": "#777777", "marker": "^", "linestyle": ":"},
    {"color": INK, "marker": "v", "linestyle": "-."},
]
HITS = ("1-10", "11-25", "26-50", "51-100", "never")


def write_evidence_figures(directory: Path, frames: Frames) -> list[Path]:
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
    figure, axes = _columns(rows, len(measures), sharey="row")
    for column, (experiment, mine) in zip(axes.T, rows.groupby("experiment"), strict=True):
        for ax, metric in zip(column, measures, strict=True):
            for decay, line in mine[mine["metric"] == metric].groupby("decay", sort=False):
                look, label = (LOOKS[0], "with time decay") if decay else (LOOKS[1], "without")
                ax.plot(line["age"], line["value"], markersize=3, label=label, **look)
        column[0].set_title(experiment_title(str(experiment), "\n{}"))
        column[-1].set_xlabel("last seen before the end [steps]")
    for ax, label in zip(axes[:, 0], measures.values(), strict=True):
        ax.set_ylim(bottom=0)  # for all of its row
        ax.set_ylabel(label)
    _one_legend(figure, axes[0])
    return figure


def strata(frames: Frames) -> Figure | None:
    """Shows what U-Net finds, and how far off it is, by when a pixel was last inside the visible region."""
    rows = _unet(frames["strata"])
    names = [name for name in STRATA if name in set(rows["stratum"])]
    if not names:
        return None
    measures = {"obstacle_recall": "obstacle pixels found", "brier": "Brier score"}
    figure, axes = _columns(rows, len(measures), sharey="row", sharex=True)
    for column, (experiment, mine) in zip(axes.T, rows.groupby("experiment"), strict=True):
        for ax, metric in zip(column, measures, strict=True):
            measured = mine[mine["metric"] == metric]
            kinds = {"with time decay": measured[measured["decay"]], "without": measured[~measured["decay"]]}
            _marks(ax, {label: kind.set_index("stratum") for label, kind in kinds.items()}, names)
        column[0].set_title(experiment_title(str(experiment), "\n{}"))
        column[-1].tick_params("x", rotation=40)
        column[-1].set_xlabel("last visible [steps ago]")
    for ax, label in zip(axes[:, 0], measures.values(), strict=True):
        ax.set_ylim(bottom=0)
        ax.set_ylabel(label)
    _one_legend(figure, axes[0])
    return figure


def obstacles(frames: Frames) -> Figure | None:
    """Shows how much of an obstacle is found, by when it was last hit: U-Net, without decay, and the tracker."""
    table = frames["obstacles"]
    rows = table[(table["metric"] == "recall") & (table["encoding"] == "projection")]
    kinds = {
        "U-Net": rows[(rows["model"] == "unet") & rows["decay"]],
        "U-Net, no decay": rows[(rows["model"] == "unet") & ~rows["decay"]],
        "Tracker": rows[rows["model"] == "tracker"],
        "Last seen": rows[rows["model"] == "last_seen"],
    }
    if kinds["U-Net"].empty:
        return None
    figure, axes = _columns(kinds["U-Net"], 1, sharey=True)
    for ax, experiment in zip(axes[0], sorted(kinds["U-Net"]["experiment"].unique()), strict=True):
        mine = {label: kind[kind["experiment"] == experiment].set_index("last_hit") for label, kind in kinds.items()}
        _marks(ax, mine, list(HITS))
        ax.set(title=experiment_title(str(experiment), "\n{}"), ylim=(0, 1), xlabel="last hit before the end [steps]")
    axes[0, 0].set_ylabel("share of the obstacle found")
    _one_legend(figure, axes[0])
    return figure


def reliability(frames: Frames) -> Figure | None:
    """Shows how often what U-Net predicts comes true."""
    rows = _unet(frames["reliability"])
    rows = rows[rows["stratum"] == "all"] if len(rows) else rows
    if rows.empty:
        return None
    figure, axes = _columns(rows, 1, sharey=True)
    for ax, (experiment, mine) in zip(axes[0], rows.groupby("experiment"), strict=True):
        ax.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=1)
        for decay, line in mine.groupby("decay", sort=False):
            look, label = (LOOKS[0], "with time decay") if decay else (LOOKS[1], "without")
            ax.plot(line["predicted"], line["found"], markersize=3, label=label, **look)
        ax.set(title=experiment_title(str(experiment), "\n{}"), xlabel="predicted probability", aspect="equal")
    axes[0, 0].set_ylabel("share that are obstacles")
    _one_legend(figure, axes[0])
    return figure


def rivals(frames: Frames) -> Figure | None:
    """Shows the obstacle IoU of every network from the paper's input, our best, and every rival, with intervals."""
    rows = _titled(frames["intervals"])
    shown = (rows["encoding"] == "projection") | (rows["model"] == "convlstm") | (rows["encoding"] == OURS[1])
    rows = rows[shown & ~rows["model"].isin(["average", "all_free"])]
    names = rows.drop_duplicates("title").sort_values(["rank", "encoding"], ascending=False)["title"].tolist()
    return _dots(rows, names) if len(names) > 1 else None


def encodings(frames: Frames) -> Figure | None:
    """Shows the obstacle IoU of U-Net from every encoding, and of a network for sequences, with intervals."""
    rows = _titled(frames["intervals"])
    rows = rows[rows["model"].isin(["unet", "convlstm"])]
    others = rows[rows["encoding"] != "projection"]
    rows = rows[rows["experiment"].isin(others["experiment"])]
    order = {name: number for number, name in enumerate(ENCODINGS)}
    rows = rows.assign(order=rows["encoding"].map(order))
    names = rows.drop_duplicates("title").sort_values(["rank", "order"], ascending=False)["title"].tolist()
    return _dots(rows, names) if len(names) > 1 else None


def transfer(frames: Frames) -> Figure | None:
    """Shows what U-Net loses on sensors, poses and speeds that it has not learned."""
    if "transfer" not in frames:
        return None
    rows = frames["transfer"]
    rows = rows[(rows["what"] != "experiment") & rows["metric"].isin(["obstacle_iou", "accuracy"])]
    if rows.empty:
        return None
    whats = list(dict.fromkeys(rows["what"]))
    size = (0.6 + 2.2 * len(whats), 4.2)
    figure, axes = plt.subplots(2, len(whats), figsize=size, layout="constrained", sharey="row", squeeze=False)
    for column, what in zip(axes.T, whats, strict=True):
        for ax, (metric, label) in zip(
            column, {"obstacle_iou": "obstacle IoU", "accuracy": "accuracy"}.items(), strict=True
        ):
            line = rows[(rows["what"] == what) & (rows["metric"] == metric)]
            amount = line["tested"].astype(float)
            spread = [line["value"] - line["low"], line["high"] - line["value"]]
            ax.errorbar(amount, line["value"], yerr=spread, markersize=3, capsize=2, **LOOKS[0])
            ax.set_ylabel(label if what == whats[0] else "")
        column[-1].set_xlabel(what)
    return figure


FIGURES: dict[str, Callable[[Frames], Figure | None]] = {
    "strata": strata,
    "ages": ages,
    "obstacles": obstacles,
    "reliability": reliability,
    "rivals": rivals,
    "encodings": encodings,
    "transfer": transfer,
}


def _unet(table: pd.DataFrame) -> pd.DataFrame:
    return table[(table["model"] == "unet") & (table["encoding"] == "projection")]


def _columns(rows: pd.DataFrame, number: int, **options: Any) -> tuple[Figure, Any]:
    """Makes a column of axes for each experiment, (number, experiments)."""
    experiments = rows["experiment"].nunique()
    size = (0.6 + 2.4 * experiments, 0.7 + 2.1 * number)
    return plt.subplots(number, experiments, figsize=size, layout="constrained", squeeze=False, **options)


def _marks(ax: Axes, kinds: dict[str, pd.DataFrame], names: list[str]) -> None:
    """Draws value and interval of each kind at each name, kinds side by side; a kind is indexed by the names."""
    for number, (look, (label, kind)) in enumerate(zip(LOOKS, kinds.items(), strict=False)):
        there = kind.reindex(names).dropna(subset=["value"])
        place = [names.index(name) + 0.16 * (number - (len(kinds) - 1) / 2) for name in there.index]
        spread = [there["value"] - there["low"], there["high"] - there["value"]]
        form = {"color": look["color"], "marker": look["marker"], "linestyle": "none", "markersize": 4}
        ax.errorbar(place, there["value"], yerr=spread, label=label, capsize=2, **form)
    ax.set_xticks(range(len(names)), names)


def _titled(table: pd.DataFrame) -> pd.DataFrame:
    """Takes the obstacle IoU with decay; adds the title of each predictor and its rank in the order of `NAMES`."""
    rows = table[(table["metric"] == "obstacle_iou") & table["decay"]]
    titles = [predictor_title(*cell) for cell in zip(rows["model"], rows["encoding"], strict=True)]
    return rows.assign(title=titles, rank=rows["model"].map(list(NAMES).index))


def _dots(rows: pd.DataFrame, names: list[str]) -> Figure:
    """Draws a dot and its interval for each title, from the bottom up, a column an experiment; networks are filled."""
    experiments = sorted(rows["experiment"].unique())
    size = (1.6 + 2.3 * len(experiments), 0.9 + 0.26 * len(names))
    figure, axes = plt.subplots(1, len(experiments), figsize=size, layout="constrained", squeeze=False, sharey=True)
    for ax, experiment in zip(axes[0], experiments, strict=True):
        for row in rows[rows["experiment"] == experiment].itertuples():
            own = row.model in LEARNED
            form = {"color": ACCENT if own else INK, "marker": "o" if own else "s", "markersize": 4, "capsize": 2}
            spread = [[row.value - row.low], [row.high - row.value]]
            ax.errorbar(
                row.value, names.index(row.title), xerr=spread, markerfacecolor=None if own else "white", **form
            )
        ax.set(title=experiment_title(str(experiment), "\n{}"), xlabel="obstacle IoU")
        ax.grid(axis="x", color="#dddddd", linewidth=0.5)
        ax.set_yticks(range(len(names)), names)
    return figure


def _one_legend(figure: Figure, axes: Any) -> None:
    """Puts one legend under the figure, of the axes with most to show."""
    handles, labels = max((ax.get_legend_handles_labels() for ax in axes), key=lambda found: len(found[1]))
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
