"""Agreement of a map with a scan that its network did not receive, which needs no true map.

Such a scan is the one after a window, or the beams outside of a cropped field of view at the time of the map.
"""

from dataclasses import dataclass

import numpy as np

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_passed, newest_visible
from repro.prediction.windows import Window
from repro.scans import Scans

SHARES = ("hits_on_obstacles", "passed_pixels_free")  # the values of `agreement`
COMPARISONS = {  # what is compared, by the prefix of its columns
    "": "next scan",
    "held_out_": "held-out beams",
    "last_hits_held_out_": "held-out beams and a map of the last hits in place of the prediction",
}


@dataclass(frozen=True)
class Observed:
    """What one scan shows of a map.

    Args:
        hits: pixels with a hit, bool, (H, W).
        passed: pixels without a hit that a beam passes over, at least one pixel before its end, bool, (H, W).
    """

    hits: np.ndarray
    passed: np.ndarray

    def within(self, pixels: np.ndarray) -> "Observed":
        """Return what the scan shows of some pixels, bool, (H, W)."""
        return Observed(self.hits & pixels, self.passed & pixels)


def observed(scan: Scans, grid: Grid, range_max_m: float) -> Observed:
    """Return what a scan shows of a map.

    Args:
        scan: one window of one step, (1, N), on the map; NaN marks the beams that are not compared.
        grid: grid of the map.
        range_max_m: maximum range of the lidar [m], up to which a miss passes over pixels.
    """
    scan = scan.batched()
    hits = newest_hits(scan, grid)[0] > 0
    passed = newest_visible(scan, grid, range_max_m, margin_m=-grid.resolution_m)[0] > 0
    return Observed(hits, passed & ~hits)


def agreement(free: np.ndarray, scan: Observed) -> tuple[float, float]:
    """Compare a map, the probability of free, (H, W), with what a scan shows of it.

    Returns:
        share of the hits at most one pixel from a predicted obstacle, since poses and grids are not exact, and share of
        the passed pixels that are predicted free; NaN where there are none.
    """
    return _share(lowest_beside(free)[scan.hits] < 0.5), _share(free[scan.passed] >= 0.5)


def lowest_beside(free: np.ndarray) -> np.ndarray:
    """Return the lowest value within one pixel of each, (H, W)."""
    beside = np.lib.stride_tricks.sliding_window_view(np.pad(free, 1, mode="edge"), (3, 3))
    return beside.min((2, 3))


def compare(window: Window, free: np.ndarray, grid: Grid, range_max_m: float) -> dict[str, float]:
    """Compare the map of a window, (H, W), with the next scan and the held-out beams; these also with `last_hits`.

    Returns:
        the values of `agreement`, named by a prefix of `COMPARISONS` and a name of `SHARES`.
    """
    shares: dict[str, tuple[float, float]] = {}
    if window.following:
        shares[""] = agreement(free, observed(window.following, grid, range_max_m))
    if window.held_out:
        scan = observed(window.held_out, grid, range_max_m)
        shares["held_out_"] = agreement(free, scan)
        shares["last_hits_held_out_"] = agreement(last_hits(window.scans, grid, range_max_m)[0], scan)
    return {prefix + name: share for prefix, pair in shares.items() for name, share in zip(SHARES, pair, strict=True)}


def last_hits(scans: Scans, grid: Grid, range_max_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Predict a map without a network: an obstacle in each pixel that no beam has passed over since it was last hit.

    Args:
        scans: one window, (T, N), on the map.
        grid: grid of the map.
        range_max_m: maximum range of the lidar [m].

    Returns:
        probability of free, 0 or 1, (H, W), and the pixels that any beam of the window has hit or passed over, bool.
    """
    window = scans.batched()
    hit = newest_hits(window, grid)[0]
    passed = newest_passed(window, grid, range_max_m)[0]
    return np.where((hit > 0) & (hit >= passed), 0.0, 1.0), (hit > 0) | (passed > 0)


def _share(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")
