"""Agreement of a map with a scan that its network did not receive, which needs no true map.

Such a scan is the one after a window, or the beams outside of a cropped field of view, which measure at the time of the
map what the network could not see.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_visible
from repro.scans import Scans


@dataclass(frozen=True)
class Measured:
    """What one scan shows of a map.

    Args:
        hits: pixels with a hit, bool, (H, W).
        passed: pixels without a hit that a beam passes over, at least one pixel before its end, bool, (H, W).
    """

    hits: np.ndarray
    passed: np.ndarray

    def within(self, pixels: np.ndarray) -> "Measured":
        """Return what the scan shows of some pixels, bool, (H, W)."""
        return Measured(self.hits & pixels, self.passed & pixels)


@dataclass(frozen=True)
class Agreement:
    """Number of pixels of a scan, and on how many of them the map agrees with it.

    Args:
        hits: hit pixels.
        hits_on_obstacles: hit pixels that are at most one pixel from a predicted obstacle.
        passed: passed pixels.
        passed_free: passed pixels that are predicted free.
    """

    hits: int
    hits_on_obstacles: int
    passed: int
    passed_free: int

    @property
    def shares(self) -> tuple[float, float]:
        """Share of the hits on obstacles and share of the passed pixels predicted free; NaN where there are none."""
        return _share(self.hits_on_obstacles, self.hits), _share(self.passed_free, self.passed)


def measured(scan: Scans, grid: Grid, range_max_m: float) -> Measured:
    """Return what a scan shows of a map.

    Args:
        scan: one window of one step, (1, N), on the map; NaN marks the beams that are not compared.
        grid: grid of the map.
        range_max_m: maximum range of the lidar [m], up to which a miss passes over pixels.
    """
    scan = scan.tensors()
    hits = (newest_hits(scan, grid) > 0)[0].numpy()
    passed = (newest_visible(scan, grid, range_max_m, margin_m=-grid.resolution_m) > 0)[0].numpy()
    return Measured(hits, passed & ~hits)


def agreement(free: np.ndarray, scan: Measured) -> Agreement:
    """Compare the probability of free, (H, W), with what a scan shows of the map."""
    near_obstacle = minimum_filter(free, 3) < 0.5
    on_obstacles, passed_free = near_obstacle[scan.hits].sum(), (free[scan.passed] >= 0.5).sum()
    return Agreement(int(scan.hits.sum()), int(on_obstacles), int(scan.passed.sum()), int(passed_free))


def last_seen(scans: Scans, grid: Grid, range_max_m: float, radius_px: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Predict a map without a network: an obstacle where the newest beam that reached a pixel of a window has hit it.

    Args:
        scans: one window, (T, N), on the map.
        grid: grid of the map.
        range_max_m: maximum range of the lidar [m].
        radius_px: half the side of the square around each such pixel, less half a pixel [px].

    Returns:
        probability of free, 0 or 1, (H, W), and the pixels that any beam of the window has hit or passed over, bool.
    """
    window = scans.tensors()
    hit = newest_hits(window, grid)[0].numpy()
    passed = newest_visible(window, grid, range_max_m, margin_m=-grid.resolution_m / 2)[0].numpy()
    near_hit = maximum_filter(hit > passed, 2 * radius_px + 1)
    return np.where(near_hit & ~(passed > hit), 0.0, 1.0), (hit > 0) | (passed > 0)


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
