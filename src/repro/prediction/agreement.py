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

COMPARISONS = {"next_scan": "next scan", "held_out": "held-out beams"}  # by the prefix of their columns
LOSSES = ("log_loss", "last_hits_log_loss")  # of the map, and of the last hits in its place
# Probability of an obstacle where the newest beam has hit, where it has passed, and where none was: the shares that
# held-out beams and the next scan hit in the 13 logs of docs/real_logs.md, in a view of 90 degrees.
LAST_HIT, LAST_PASSED, NEVER_SEEN = 0.9, 0.02, 0.1
SURE = 1e-3  # probabilities nearer to 0 or 1 count as that, so that one pixel does not decide


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
        range_max_m: maximum range of the lidar [m], up to which a miss passes over pixels.
    """
    scan = scan.batched()
    hits = newest_hits(scan, grid)[0] > 0
    passed = newest_visible(scan, grid, range_max_m, margin_m=-grid.resolution_m)[0] > 0
    return Observed(hits, passed & ~hits)


def log_loss(free: np.ndarray, scan: Observed) -> float:
    """Return the mean negative log-likelihood of what a scan shows [nat a pixel]; NaN if it shows nothing.

    Every pixel that the scan hits or passes over counts once, at its own place. 0 is perfect, 0.69 is a coin.

    Args:
        free: probability of free, (H, W).
        scan: what the scan shows of the map.
    """
    right = np.concatenate([1 - free[scan.hits], free[scan.passed]]).clip(SURE, 1 - SURE)
    return float(-np.log(right).mean()) if len(right) else float("nan")


def compare_with_scans(window: Window, free: np.ndarray, grid: Grid, range_max_m: float) -> dict[str, float]:
    """Compare the map of a window, the probability of free, (H, W), with the next scan and with the held-out beams.

    Returns:
        the log loss of the map and that of a map of the last hits, named by a key of `COMPARISONS` and one of `LOSSES`.
    """
    empty, seen = last_hits(window.scans, grid, range_max_m)
    usual = 1 - np.where(empty == 0, LAST_HIT, np.where(seen, LAST_PASSED, NEVER_SEEN))
    losses: dict[str, float] = {}
    for name, scan in zip(COMPARISONS, (window.following, window.held_out), strict=True):
        if scan:
            shown = observed(scan, grid, range_max_m)
            losses |= {f"{name}_{LOSSES[0]}": log_loss(free, shown), f"{name}_{LOSSES[1]}": log_loss(usual, shown)}
    return losses


def last_hits(scans: Scans, grid: Grid, range_max_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Predict a map without a network: an obstacle in each pixel that no beam has passed over since it was last hit.

    Args:
        scans: one window, (T, N), on the map.
        range_max_m: maximum range of the lidar [m].

    Returns:
        probability of free, 0 or 1, (H, W), and the pixels that any beam of the window has hit or passed over, bool.
    """
    window = scans.batched()
    hit = newest_hits(window, grid)[0]
    passed = newest_passed(window, grid, range_max_m)[0]
    return np.where((hit > 0) & (hit >= passed), 0.0, 1.0), (hit > 0) | (passed > 0)
