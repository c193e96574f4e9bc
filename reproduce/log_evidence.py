"""What the scans of a window show of each pixel, and maps from it without a network: distances, counts, regression."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from repro.maps.grid import Grid
from repro.maps.series import Series
from repro.metrics.counts import LEVELS
from repro.prediction.agreement import last_hits
from repro.scans import Scans

PARTS = 10  # of a window, in which hits and passes are counted
HIT_BAND, UNSEEN_BAND = LEVELS // 2, 3 * LEVELS // 4  # levels of last hits, of unseen and, above, of passed pixels
NEIGHBORHOOD_M, WALL_M = 1.0, 5.0  # hits that give the direction of a wall; how far it is continued
LINEAR = 0.1  # largest ratio of the variances across and along a wall
DISTANCE_WEIGHTS = (0.0, 0.15, 0.5, 1.0)  # candidates, chosen on other logs than those tested
PASSED_WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0)
CONSTANTS = tuple(product(DISTANCE_WEIGHTS, PASSED_WEIGHTS))


@dataclass(frozen=True)
class Evidence:
    """What a window shows of each pixel, (H, W) each; distances are logarithms of pixels.

    Args:
        hit: whether a beam hit the pixel and none passed over it later.
        seen: whether any beam hit it or passed over it.
        odds: logarithm of the odds of a pass against a hit, from the parts of the window with either.
        to_hit: distance to the last hits.
        to_passed: distance to the pixels that were seen and are no last hits.
        to_wall: distance to the last hits and the straight continuations of walls, up to pixels that were seen.
        to_robot: distance to the last pose.
    """

    hit: np.ndarray
    seen: np.ndarray
    odds: np.ndarray
    to_hit: np.ndarray
    to_passed: np.ndarray
    to_wall: np.ndarray
    to_robot: np.ndarray

    def design(self, walls: bool) -> np.ndarray:
        """Return the features of a regression, (H W, F): one slope and constant per kind of pixel and quantity."""
        names = ("odds", "to_hit", "to_passed", "to_robot", *(("to_wall",) if walls else ()))
        columns = np.stack([np.ones(self.hit.size), *(getattr(self, name).ravel() for name in names)])
        kinds = np.stack([self.hit, self.seen & ~self.hit, ~self.seen]).reshape(3, 1, -1)
        return (kinds * columns).reshape(-1, self.hit.size).T


def evidence_of(scans: Scans, grid: Grid, range_max_m: float) -> Evidence:
    """Collect the evidence of one window, (T, N), on the map."""
    free, seen = last_hits(scans, grid, range_max_m)
    hit = free < 0.5
    images = Series(PARTS, range_max_m).encode(scans.tensors(), grid)[0].numpy() == 0
    hits, passes = images[:PARTS].sum(0), images[PARTS:].sum(0)
    from_robot = grid.centers().numpy().reshape(*hit.shape, 2) - scans.poses[-1, :2]
    to_robot = np.log1p(np.linalg.norm(from_robot, axis=-1) / grid.resolution_m)
    walls = hit | (continued_walls(hit, grid) & ~seen)
    to_hit, to_passed, to_wall = (_log_distance(pixels) for pixels in (hit, seen & ~hit, walls))
    return Evidence(hit, seen, np.log((passes + 0.5) / (hits + 0.5)), to_hit, to_passed, to_wall, to_robot)


def distance_map(evidence: Evidence) -> np.ndarray:
    """Rank pixels by their distance to the last hits, and passed pixels as more likely free than unseen ones.

    Returns:
        levels from 0, the last hits, to 255, certainly free: unseen pixels from 128 and passed ones from 192 on.
    """
    octaves = np.rint(8 * evidence.to_hit / np.log(2))
    level = HIT_BAND + np.minimum(octaves, LEVELS // 4 - 1) + np.where(evidence.seen, UNSEEN_BAND - HIT_BAND, 0)
    return np.where(evidence.hit, 0, level).astype(np.int64)


def score_map(evidence: Evidence, distance_weight: float, passed_weight: float) -> np.ndarray:
    """Rank last hits below unseen and passed pixels, and the pixels of each kind by counts and distances.

    Last hits and passed pixels are ranked by the odds of a pass and the distance to the last hits, unseen pixels by
    the distances to the last hits and to the passed pixels.
    """
    seen = _levels(evidence.odds + distance_weight * evidence.to_hit, -3.1, 8.0)
    unseen = _levels(evidence.to_hit - passed_weight * evidence.to_passed, -5.0, 5.2)
    levels = np.where(evidence.seen, UNSEEN_BAND + seen * (LEVELS - UNSEEN_BAND), 0)
    levels = np.where(evidence.seen, levels, HIT_BAND + unseen * (UNSEEN_BAND - HIT_BAND))
    return np.where(evidence.hit, seen * HIT_BAND, levels).astype(np.int64)


def fit(designs: list[np.ndarray], free: list[np.ndarray]) -> Pipeline:
    """Fit a logistic regression of free, bool, (P,), on the features of pixels, (P, F), of several logs."""
    model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=500))
    return model.fit(np.concatenate(designs), np.concatenate(free))


def regression_map(evidence: Evidence, model: Pipeline, walls: bool) -> np.ndarray:
    """Rank the pixels by a regression; levels are 12 per unit of its logit, and obstacles are below 127.5."""
    logit = model.decision_function(evidence.design(walls)).reshape(evidence.hit.shape)
    return np.clip(np.rint((LEVELS - 1) / 2 + 12 * logit), 0, LEVELS - 1).astype(np.int64)


def continued_walls(hit: np.ndarray, grid: Grid) -> np.ndarray:
    """Continue walls straight on: from each hit along the line through its neighbors, if they lie on one, bool."""
    pixels = np.argwhere(hit)
    walls = np.zeros_like(hit)
    if len(pixels) < 3:
        return walls
    neighbors = cKDTree(pixels).query_ball_point(pixels, NEIGHBORHOOD_M / grid.resolution_m)
    steps = np.arange(-WALL_M, WALL_M, grid.resolution_m / 2) / grid.resolution_m
    for pixel, near in zip(pixels, neighbors, strict=True):
        if len(near) < 3:
            continue
        variances, axes = np.linalg.eigh(np.cov(pixels[near].T))
        if variances[0] <= LINEAR * variances[1]:
            line = np.rint(pixel + steps[:, None] * axes[:, 1]).astype(int)
            line = line[((line >= 0) & (line < len(hit))).all(1)]
            walls[line[:, 0], line[:, 1]] = True
    return walls


def _log_distance(pixels: np.ndarray) -> np.ndarray:
    """Return the logarithm of the distance to some pixels [px], at least 0; of the whole map where there are none."""
    if not pixels.any():
        return np.full(pixels.shape, np.log(len(pixels)))
    return np.log(np.maximum(distance_transform_edt(~pixels), 1.0))


def _levels(score: np.ndarray, low: float, high: float) -> np.ndarray:
    """Scale a score to [0, 1)."""
    return np.clip((score - low) / (high - low), 0, 1 - 1e-9)
