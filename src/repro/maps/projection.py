"""The paper's encoding, the cumulative dynamic sensor projection."""

import math
from typing import ClassVar

import numpy as np
from pydantic.dataclasses import dataclass

from repro.maps.grid import Grid
from repro.scans import Scans
from repro.system.compiled import compiled
from repro.system.fields import OLDEST_GRAY, STRICT, Gray
from repro.system.threads import in_threads


@dataclass(frozen=True, config=STRICT)
class Projection:
    """The cumulative dynamic sensor projection: one gray-scale image, 0 black to 255 white.

    Every hit is placed in the global frame by pose and beam angle. The newest hit of a pixel
    determines its gray: of T steps, the last is black (0), the first has the gray `oldest_gray`, and the steps between
    are interpolated linearly. The background is white.

    Paper: "Cumulative Dynamic Sensor Projection" and, for `decay=False`, "Ablation Study". The decay law is not
    stated: DEVIATIONS D7.

    Args:
        decay: False draws all hits black.
        oldest_gray: gray of the oldest hit, in [0, 254/255]; 1 is the white background.

    Raises:
        ValueError: a parameter has another type or is out of its range.
    """

    name: ClassVar[str] = "projection"
    channels: ClassVar[int] = 1
    frames: ClassVar[int] = 1
    bits: ClassVar[int] = 8
    is_inverted: ClassVar[bool] = False
    reach_m: ClassVar[float] = 0.0

    decay: bool = True
    oldest_gray: Gray = OLDEST_GRAY

    def with_range(self, range_max_m: float) -> "Projection":
        return self

    def encode(self, scans: Scans, grid: Grid) -> np.ndarray:
        """Draw the projection of each window.

        Args:
            scans: a batch of windows, see `Scans.batched`.

        Returns:
            gray images, uint8, (B, 1, H, W); darker is more recent.
        """
        steps = scans.ranges.shape[1]
        shades = np.zeros(steps + 1, dtype=np.float32)
        if self.decay:
            shades[1:] = np.linspace(0, self.oldest_gray, steps)[::-1]
        shades[0] = 1
        return np.rint(255 * shades).astype(np.uint8)[newest_hits(scans, grid)][:, None]


def newest_hits(scans: Scans, grid: Grid) -> np.ndarray:
    """Return the newest step at which each pixel was hit.

    Args:
        scans: a batch of windows, see `Scans.batched`.

    Returns:
        the step, counted from 1, 0 without a hit, int32, (B, H, W).
    """
    return _hits(scans, grid)[0]


def count_hits(scans: Scans, grid: Grid) -> np.ndarray:
    """Return the number of steps at which each pixel was hit, int32, (B, H, W), see `newest_hits`."""
    return _hits(scans, grid)[1]


def _hits(scans: Scans, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return the newest step at which each pixel was hit, and the number of these steps."""
    newest, counts = np.zeros((2, len(scans), grid.size_px, grid.size_px), dtype=np.int32)
    resolution_m = scans.ranges.dtype.type(grid.resolution_m)
    of_scans = scans.ranges, scans.angles, scans.poses
    in_threads(lambda part: _draw_hits(newest, counts, *of_scans, part, resolution_m), len(scans))
    return newest, counts


@compiled
def _draw_hits(
    newest: np.ndarray,
    counts: np.ndarray,
    ranges: np.ndarray,
    angles: np.ndarray,
    poses: np.ndarray,
    part: np.ndarray,
    resolution_m: float,
) -> None:
    """Draw the hits of some windows, oldest first.

    Args:
        newest: the newest step of a hit in each pixel, counted from 1, (B, H, W).
        counts: the number of steps with a hit in each pixel, (B, H, W).
        ranges: ranges [m], (B, T, N); one that is not finite is no hit.
        angles: beam angles [rad], (N,).
        poses: x, y [m], heading [rad], (B, T, 3); one that is not finite has no hits.
        part: indices of the windows.
        resolution_m: side of a pixel [m], in the type of the others, as all sums and products.
    """
    size = newest.shape[1]
    for window in part:
        for step in range(ranges.shape[1]):
            x, y, heading = poses[window, step]
            for beam in range(len(angles)):
                distance = ranges[window, step, beam]
                if not math.isfinite(distance):
                    continue
                bearing = heading + angles[beam]
                column = np.floor((x + distance * math.cos(bearing)) / resolution_m)
                above = np.floor((y + distance * math.sin(bearing)) / resolution_m)
                if 0 <= column < size and 0 <= above < size:  # false for NaN
                    pixel = window, size - 1 - int(above), int(column)
                    counts[pixel] += newest[pixel] != step + 1
                    newest[pixel] = step + 1
