"""Files of a prediction: probabilities, a map for map_server, and a figure."""

from pathlib import Path

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.prediction.ros import OCCUPIED_ABOVE
from repro.prediction.stream import StreamMap
from repro.prediction.windows import Window

FREE_BELOW = 0.05  # probability of an obstacle; map_server's 0.25 would include pixels out of sight
UNKNOWN = 255  # in a map for map_server


def write_probabilities(path: Path, predicted: StreamMap) -> None:
    """Write a map as npz: `free`, `unknown` (H, W), row 0 at the top, origin [m], resolution [m] and stamp [s]."""
    np.savez_compressed(
        path,
        free=predicted.free.astype(np.float32),
        unknown=predicted.unknown,
        origin=np.array(predicted.origin),
        resolution=np.array(predicted.resolution_m),
        stamp=np.array(predicted.stamp),
    )


def write_map(stem: Path, predicted: StreamMap) -> None:
    """Write <stem>.pgm and <stem>.yaml as map_server reads them, in mode `raw`.

    A pixel is 0 below `FREE_BELOW`, 100 above `OCCUPIED_ABOVE`, in proportion between them, and `UNKNOWN` where no
    reading supports the map and no obstacle is predicted. Row 0 is the top. The origin is the lower left corner of the
    map in the frame of the log [m].

    Source: nav2_map_server, map_io.cpp.
    """
    occupied = 1 - predicted.free.astype(float)
    share = ((occupied - FREE_BELOW) / (OCCUPIED_ABOVE - FREE_BELOW)).clip(0, 1)
    is_unknown = predicted.unknown & (occupied <= OCCUPIED_ABOVE)
    Image.fromarray(np.where(is_unknown, UNKNOWN, np.rint(100 * share)).astype(np.uint8)).save(stem.with_suffix(".pgm"))
    content = {
        "image": stem.with_suffix(".pgm").name,
        "mode": "raw",
        "resolution": predicted.resolution_m,
        "origin": [*predicted.origin, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_ABOVE,
        "free_thresh": FREE_BELOW,
    }
    stem.with_suffix(".yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def draw(window: Window, free: np.ndarray, grid: Grid) -> Figure:
    """Draw the hits of a window (the paper's image, also for networks with another input), the map, the last scan."""
    left, bottom = window.origin
    extent = (left, left + grid.size_m, bottom, bottom + grid.size_m)
    figure = Figure(figsize=(10, 3.7))  # without pyplot, whose backend may be one of a notebook
    axes = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(left=0.07, right=0.985, bottom=0.11, top=0.95, wspace=0.05)  # faster than a fitted layout
    hits = Projection().encode(window.scans.batched(), grid)[0, 0]
    _image(axes[0], hits, extent, "hits of the window, dark is recent")
    _image(axes[1], 255 * free, extent, f"predicted map at {window.stamp:.1f} s")
    held_out = ", red; held out, orange" if window.held_out else ""
    _image(axes[2], np.full_like(free, 255), extent, f"last scan{held_out}")
    for scan, color in ((window.held_out, "#e08a00"), (window.scans, "#b3261e")):
        if scan:
            points, hit = (each[-1] for each in scan.points())
            axes[2].plot(*(points[hit] + window.origin).T, ".", color=color, markersize=2)
    for ax in axes:
        path = window.scans.poses[:, :2] + window.origin
        ax.plot(*path.T, color="#0b6e99", linewidth=1)
        ax.plot(*path[-1], "o", color="#0b6e99", markersize=4)
        ax.set_xlabel("x [m]")
    axes[0].set_ylabel("y [m]")
    return figure


def _image(ax: Axes, image: np.ndarray, extent: tuple[float, float, float, float], title: str) -> None:
    ax.imshow(image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
    ax.set(title=title, xlim=extent[:2], ylim=extent[2:])
