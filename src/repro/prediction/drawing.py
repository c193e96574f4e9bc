"""Figures of predicted maps, in which what no beam has reached is tinted and never looks like free space.

    repro.draw_map(predicted).savefig("map.png")

Matplotlib is imported by the functions that draw, since a robot needs none.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.prediction.agreement import observed
from repro.prediction.stream_map import StreamMap
from repro.prediction.windows import Window
from repro.scans import Scans
from repro.system.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TINT = (0.70, 0.82, 0.93)  # light blue, of pixels that no beam has reached
HITS, MOVING, HELD_OUT, ROBOT = "#d62728", "#e08a00", "#8e44ad", "#0b6e99"


def _check_matplotlib() -> None:
    if find_spec("matplotlib") is None:
        raise InputError("a figure needs Matplotlib: pip install matplotlib")


def shade(free: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """Return the colors of a map, (H, W, 3) from 0 to 1: white is free, black an obstacle, light blue is unknown.

    An obstacle that is predicted where no beam has been is dark, too.

    Args:
        free: probability of free, (H, W).
        unknown: pixels that no reading supports, bool, (H, W).
    """
    return np.where(unknown[..., None], TINT, 1.0) * np.asarray(free, dtype=float)[..., None]


def draw_map(predicted: StreamMap, axes: Axes | None = None) -> Figure:
    """Draw a map with the newest hits, what moves, the robot, a color bar and a legend.

    Args:
        axes: where to draw, without color bar and legend; None for a new figure.

    Returns:
        the figure, of which `savefig(path)` writes an image.

    Raises:
        InputError: there is no map, as before the scans fill a window, or Matplotlib is not installed.
    """
    if predicted is None:
        raise InputError("expected a map of a stream, got None: its scans do not fill a window, see `reason`")
    _check_matplotlib()
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    is_alone = axes is None
    if axes is None:
        figure = Figure(figsize=(5.4, 5.2))  # without pyplot, whose backend may be one of a notebook
        axes = figure.add_axes((0.11, 0.2, 0.74, 0.75))
        bar = figure.colorbar(ScalarMappable(cmap="gray"), cax=figure.add_axes((0.87, 0.2, 0.025, 0.75)))
        bar.set_label("probability of free")
        axes.set(xlabel="x [m]", ylabel="y [m]")
    _show(axes, shade(predicted.free, predicted.unknown), predicted.origin, predicted.resolution_m)
    rows, columns = np.nonzero(predicted.moving)
    half = np.array(predicted.free.shape[:1]) - 0.5  # [px]
    places = np.stack([columns + 0.5, half - rows], -1) * predicted.resolution_m + predicted.origin
    if len(rows):
        axes.plot(*places.T, ".", color=MOVING, markersize=2, label="hits on what moves")
    axes.plot(*predicted.hits.T, ".", color=HITS, markersize=2, label="newest hits")
    _draw_robot(axes, np.array(predicted.pose))
    if is_alone:
        _add_legend(axes.figure, [axes])  # type: ignore[arg-type]
    return axes.figure  # type: ignore[return-value]


def draw_window(window: Window, predicted: StreamMap, grid: Grid, range_max_m: float, when: str) -> Figure:
    """Draw the hits of a window, its map, and what scans show that the network did not receive.

    Args:
        predicted: its map.
        range_max_m: maximum range of the lidar [m], up to which a miss shows free pixels.
        when: time of the map, for its title.
    """
    _check_matplotlib()
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.4))
    axes = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(left=0.06, right=0.92, bottom=0.18, top=0.94, wspace=0.04)  # faster than a fitted layout
    bar = figure.colorbar(ScalarMappable(cmap="gray"), cax=figure.add_axes((0.935, 0.18, 0.012, 0.76)))
    bar.set_label("probability of free")
    gray = Projection().encode(window.scans.batched(), grid)[0, 0] / 255  # also where the network sees others
    pixels = predicted.resolution_m
    _show(axes[0], shade(gray, predicted.unknown), window.origin, pixels)
    axes[0].set_title("hits of the window, dark is recent", fontsize=10)
    axes[0].set_ylabel("y [m]")
    axes[0].plot(*(window.scans.poses[:, :2] + window.origin).T, color=ROBOT, linewidth=1, label="path of the robot")
    _draw_robot(axes[0], np.array(predicted.pose))
    draw_map(predicted, axes[1])
    axes[1].set_title(f"predicted map at {when}", fontsize=10)
    _draw_truth(axes[2], window, grid, range_max_m)
    for ax in axes:
        ax.set_xlabel("x [m]")
    _add_legend(figure, list(axes))
    return figure


def _draw_truth(axes: Axes, window: Window, grid: Grid, range_max_m: float) -> None:
    """Draw what the next scan and the held-out beams show, with which the map is compared."""
    seen, free = np.zeros((grid.size_px, grid.size_px), bool), np.ones((grid.size_px, grid.size_px))
    for scan in (window.following, window.held_out):
        if scan:
            shown = observed(scan, grid, range_max_m)
            seen |= shown.hits | shown.passed
            free[shown.hits] = 0
    _show(axes, shade(free, ~seen), window.origin, grid.resolution_m)
    if window.held_out:
        _plot_hits(axes, window.held_out, window.origin, HELD_OUT, "held-out hits")
    if window.following:
        _plot_hits(axes, window.following, window.origin, ROBOT, "hits of the next scan")
    names = [name for name, scan in (("next scan", window.following), ("held-out beams", window.held_out)) if scan]
    axes.set_title(f"truth: {' and '.join(names) or 'none'}", fontsize=10)


def _plot_hits(axes: Axes, scan: Scans, origin: tuple[float, float], color: str, label: str) -> None:
    points, is_hit = scan.points()
    axes.plot(*(points[is_hit] + origin).T, ".", color=color, markersize=2, label=label)


def _draw_robot(axes: Axes, pose: np.ndarray) -> None:
    """Draw the robot, as a dot with a line ahead."""
    ahead = pose[:2] + 0.04 * np.diff(axes.get_xlim()) * (np.cos(pose[2]), np.sin(pose[2]))
    axes.plot(*np.stack([pose[:2], ahead]).T, color=ROBOT, linewidth=1.5)
    axes.plot(*pose[:2], "o", color=ROBOT, markersize=5, label="robot, its heading")


def _show(axes: Axes, image: np.ndarray, origin: tuple[float, float], resolution_m: float) -> None:
    height, width = image.shape[:2]
    extent = (origin[0], origin[0] + width * resolution_m, origin[1], origin[1] + height * resolution_m)
    axes.imshow(image, extent=extent, interpolation="nearest")
    axes.set(xlim=extent[:2], ylim=extent[2:])


def _add_legend(figure: Figure, drawn: list[Axes]) -> None:
    from matplotlib.patches import Patch

    handles = {label: handle for ax in drawn for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    handles["no beam has been there"] = Patch(facecolor=TINT)
    figure.legend(list(handles.values()), list(handles), loc="lower center", ncols=2 * len(drawn), fontsize=8)
