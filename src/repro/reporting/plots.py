"""Shared parts of all figures: styles, files, axes, marks with intervals, one legend."""

from collections.abc import Iterable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from repro.reporting.names import experiment_title

INK, ACCENT = "#222222", "#0b6e99"
STYLE: Any = {"font.size": 9, "axes.titlesize": 9, "axes.edgecolor": INK, "pdf.fonttype": 42, "savefig.dpi": 200}
DataFrames = dict[str, pd.DataFrame]
SUFFIXES = ("png", "pdf")  # of figures
COLORS, LINES, MARKERS = (ACCENT, "#d1711a", "#777777", INK), ("-", "--", ":", "-."), "os^vDPX*"
LOOKS: list[dict[str, Any]] = [  # distinguishable by their markers without color
    {"color": COLORS[number % 4], "linestyle": LINES[number % 4], "marker": marker}
    for number, marker in enumerate(MARKERS)
]


def columns(rows: pd.DataFrame, number: int, **options: Any) -> tuple[Figure, Any]:
    """Create a figure with one column of axes per experiment, (number, experiments)."""
    experiments = rows["experiment"].nunique()
    size = (0.6 + 2.4 * experiments, 0.7 + 2.1 * number)
    return plt.subplots(number, experiments, figsize=size, layout="constrained", squeeze=False, **options)


def panels(axes: Iterable[Axes], rows: pd.DataFrame) -> Iterator[tuple[Axes, pd.DataFrame]]:
    """Yield the axes of each experiment, with its title, and its rows."""
    for ax, (experiment, own_rows) in zip(axes, rows.groupby("experiment"), strict=True):
        ax.set_title(experiment_title(str(experiment), "\n{}"))
        yield ax, own_rows


def marks(ax: Axes, kinds: dict[str, pd.DataFrame], names: list[str]) -> None:
    """Draw value and interval of each kind at each name, kinds side by side; the names are the index of each frame."""
    for number, (look, (label, kind)) in enumerate(zip(cycle(LOOKS), kinds.items(), strict=False)):
        rows = kind.reindex(names).dropna(subset=["value"])
        position = [names.index(name) + 0.16 * (number - (len(kinds) - 1) / 2) for name in rows.index]
        spread = [rows["value"] - rows["low"], rows["high"] - rows["value"]]
        form = {"color": look["color"], "marker": look["marker"], "linestyle": "none", "markersize": 4}
        ax.errorbar(position, rows["value"], yerr=spread, label=label, capsize=2, **form)
    ax.set_xticks(range(len(names)), names)


def one_legend(figure: Figure, axes: Any, rows: int = 1) -> None:
    """Add one legend below the figure, in some rows, with the entries of the axes that have most of them."""
    handles, labels = max((ax.get_legend_handles_labels() for ax in axes), key=lambda entries: len(entries[1]))
    figure.legend(handles, labels, loc="outside lower center", ncols=-(-len(labels) // rows), frameon=False)


def save_or_delete(figure: Figure | None, stem: Path) -> Path | None:
    """Write a figure, see `save`, or delete its files without one; return the PNG file if it is written."""
    if figure:
        return save(figure, stem)
    for suffix in SUFFIXES:
        stem.with_name(f"{stem.name}.{suffix}").unlink(missing_ok=True)
    return None


def save(figure: Figure, stem: Path, suffixes: Iterable[str] = SUFFIXES) -> Path:
    """Write a figure as <stem>.<suffix> and close it; return the PNG file."""
    for suffix in suffixes:
        figure.savefig(stem.with_name(f"{stem.name}.{suffix}"), bbox_inches="tight", pad_inches=0.05)
    plt.close(figure)
    return stem.with_name(f"{stem.name}.png")
