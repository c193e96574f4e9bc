"""Occupancy grids filtered step by step, as a mapping stack would do with the same scans."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.ndimage import correlate

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_passed
from repro.recordings.recorded import Recorded
from repro.scans import Scans

PRIOR = 0.08  # prior probability of an obstacle, its share in the paper's dynamic worlds
HIT, PASSED = 0.9, 0.05  # probability of an obstacle, given a single beam that ended in the pixel or passed through it
BATCH = 64  # recordings that are filtered at a time
PRIOR_LOGIT = math.log(PRIOR / (1 - PRIOR))
HIT_GAIN, PASSED_GAIN = (math.log(p / (1 - p)) - PRIOR_LOGIT for p in (HIT, PASSED))  # of the log-odds in a step


def log_odds_grid(recorded: Recorded, forgetting: float) -> np.ndarray:
    """Filter a log-odds occupancy grid with forgetting (Elfes 1989; forgetting as in Yguel et al. 2007).

    Every step computes l <- (1 - forgetting) l, then l <- l + log(p / (1 - p)) - log(prior / (1 - prior)) with
    p = `HIT` in pixels where a beam ended and p = `PASSED` in pixels that a beam passed through.

    Args:
        recorded: recordings, (M, T, N).
        forgetting: share of the log-odds that is forgotten in every step.

    Returns:
        probability of an obstacle at the last step, (M, H, W).
    """
    maps = []
    for scans in _parts(recorded):
        log_odds = np.zeros((len(scans), recorded.grid.size_px, recorded.grid.size_px), np.float32)
        for hit, passed in _observations(scans, recorded.grid, recorded.range_max_m):
            log_odds *= 1 - forgetting
            log_odds += HIT_GAIN * hit + PASSED_GAIN * passed
            log_odds.clip(-8, 8, out=log_odds)
        maps.append(1 / (1 + np.exp(-(log_odds + PRIOR_LOGIT))))
    return np.concatenate(maps)


def transitional_grid(recorded: Recorded, moving: float) -> np.ndarray:
    """Filter static and dynamic occupancy together, following transitional grid maps (arXiv 2401.06518).

    A pixel is free, static or dynamic. In every step, dynamic occupancy spreads to the eight neighboring pixels with
    probability `moving`, and one percent of it becomes static. Bayes' rule then applies the likelihoods of a hit and of
    a passing beam.

    Args:
        recorded: recordings, (M, T, N).
        moving: probability that dynamic occupancy leaves its pixel in a step.

    Returns:
        probability of an obstacle of either kind at the last step, (M, H, W).
    """
    spread = np.full((1, 3, 3), moving / 8, np.float32)
    spread[0, 1, 1] = 1 - moving
    rest = 0.01
    hit_odds, passed_odds = (p / (1 - p) * (1 - PRIOR) / PRIOR for p in (HIT, PASSED))
    maps = []
    for scans in _parts(recorded):
        static = np.full((len(scans), recorded.grid.size_px, recorded.grid.size_px), PRIOR / 2, np.float32)
        dynamic = static.copy()
        for hit, passed in _observations(scans, recorded.grid, recorded.range_max_m):
            dynamic = correlate(dynamic, spread, mode="nearest")
            static = static + rest * dynamic
            dynamic = np.minimum((1 - rest) * dynamic, 1 - static)
            odds = np.where(hit, hit_odds, np.where(passed, passed_odds, 1.0)).astype(np.float32)  # of occupied to free
            total = 1 - static - dynamic + odds * (static + dynamic)
            static, dynamic = ((odds * p / total).clip(1e-4, 0.999) for p in (static, dynamic))
        maps.append(np.minimum(static + dynamic, 1))
    return np.concatenate(maps)


def observation(scans: Scans, grid: Grid, range_max_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels in which beams of scans ended and those they only passed through, bool, each (B, H, W)."""
    hit = newest_hits(scans, grid) > 0
    return hit, (newest_passed(scans, grid, range_max_m) > 0) & ~hit


def _observations(scans: Scans, grid: Grid, range_max_m: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the observation of every step."""
    for step in range(scans.ranges.shape[1]):
        one = Scans(scans.ranges[:, step : step + 1], scans.angles, scans.poses[:, step : step + 1])
        yield observation(one, grid, range_max_m)


def _parts(recorded: Recorded) -> list[Scans]:
    return [recorded.scans[first : first + BATCH] for first in range(0, len(recorded), BATCH)]
