"""What the figures of the analysis share: looks, axes, marks with intervals, one legend."""

from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from repro.reporting.figures import ACCENT, INK

Frames = dict[str, pd.DataFrame]
LOOKS: list[dict[str, Any]] = [  # told apart by mark and line, not by colour alone
    {"color": ACCENT, "marker": "o", "linestyle": "-"},
    {"color": "#d1711a", "marker": "s", "linestyle": "--"},
    {"color": "#777777", "marker": "^", "linestyle": ":"},
    {"color": INK, "marker": "v", "linestyle": "-."},
]


def columns(rows: pd.DataFrame, number: int, **options: Any) -> tuple[Figure, Any]:
    """Makes a column of axes for each experiment, (number, experiments)."""
    experiments = rows["experiment"].nunique()
    size = (0.6 + 2.4 * experiments, 0.7 + 2.1 * number)
    return plt.subplots(number, experiments, figsize=size, layout="constrained", squeeze=False, **options)


def marks(ax: Axes, kinds: dict[str, pd.DataFrame], names: list[str]) -> None:
    """Draws value and interval of each kind at each name, kinds side by side; a kind is indexed by the names."""
    for number, (look, (label, kind)) in enumerate(zip(LOOKS, kinds.items(), strict=False)):
        there = kind.reindex(names).dropna(subset=["value"])
        place = [names.index(name) + 0.16 * (number - (len(kinds) - 1) / 2) for name in there.index]
        spread = [there["value"] - there["low"], there["high"] - there["value"]]
        form = {"color": look["color"], "marker": look["marker"], "linestyle": "none", "markersize": 4}
        ax.errorbar(place, there["value"], yerr=spread, label=label, capsize=2, **form)
    ax.set_xticks(range(len(names)), names)


def one_legend(figure: Figure, axes: Any) -> None:
    """Puts one legend under the figure, of the axes with most to show."""
    handles, labels = max((ax.get_legend_handles_labels() for ax in axes), key=lambda found: len(found[1]))
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
