"""What the scans of a window show of each pixel, and maps from it without a network: counts, regression."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, uniform_filter
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.series import Series
from repro.maps.visibility import newest_passed
from repro.metrics.counts import LEVELS
from repro.scans import Scans
from reproduce.real.logs import Case
from reproduce.real.measures import neighbors

PARTS = 10  # of a window, in which hits and passes are counted
UNSEEN_BAND, PASSED_BAND = LEVELS // 2, 3 * LEVELS // 4  # first levels of unseen and of passed pixels; last hits from 0
NEIGHBORHOOD_M, WALL_M = 1.0, 5.0  # side of the square whose hits give the direction of a wall; how far it is continued
CENTER = 4  # of the nine pixels within one pixel
LINEAR = 0.1  # largest ratio of the variances across and along a wall
QUANTITIES = ("odds", "hits", "passes", "age", "to_hit", "to_passed", "to_robot", "to_wall")  # of a regression
SQUARED = ("to_hit", "to_passed", "to_robot", "to_wall")


@dataclass(frozen=True)
class Evidence:
    """What a window shows of pixels, arrays of one shape; all but the first two are logarithms.

    Args:
        hit: whether a beam hit the pixel and none passed over it later.
        seen: whether any beam hit it or passed over it.
        odds: the odds of a pass against a hit, from the parts of the window with either.
        hits: one more than the parts of the window with a hit.
        passes: one more than the parts of the window with a pass.
        age: one more than the steps since it was last seen.
        to_hit: distance to the last hits [px].
        to_passed: distance to the pixels that were seen and are no last hits [px].
        to_robot: one more than the distance to the last pose [px].
        to_wall: distance to the last hits and the straight continuations of walls over unseen pixels [px].
    """

    hit: np.ndarray
    seen: np.ndarray
    odds: np.ndarray
    hits: np.ndarray
    passes: np.ndarray
    age: np.ndarray
    to_hit: np.ndarray
    to_passed: np.ndarray
    to_robot: np.ndarray
    to_wall: np.ndarray

    def at(self, pixels: np.ndarray) -> "Evidence":
        """Return the evidence at flat indices of pixels, in their shape, in float32."""
        kept = {name: values.ravel()[pixels] for name, values in vars(self).items()}
        return Evidence(
            **{name: each if each.dtype == bool else each.astype(np.float32) for name, each in kept.items()}
        )

    def design(self) -> np.ndarray:
        """Return the features of a regression, (pixels, F): for each kind of pixel a constant, slopes and squares."""
        columns = [getattr(self, name).ravel() for name in QUANTITIES]
        columns += [getattr(self, name).ravel() ** 2 for name in SQUARED]
        kinds = np.stack([self.hit, self.seen & ~self.hit, ~self.seen]).reshape(3, 1, -1)
        return (kinds * np.stack([np.ones_like(columns[0]), *columns])).reshape(-1, self.hit.size).T


def join(parts: list[Evidence]) -> Evidence:
    """Return the evidence of several windows, one after the other."""
    return Evidence(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def evidence_of(scans: Scans, grid: Grid, range_max_m: float) -> Evidence:
    """Collect the evidence of one window, (T, N), on the map."""
    window = scans.batched()
    last_hit = newest_hits(window, grid)[0]
    last_passed = newest_passed(window, grid, range_max_m)[0]
    newest = np.maximum(last_hit, last_passed)
    seen, hit = newest > 0, (last_hit > 0) & (last_hit >= last_passed)
    images = Series(PARTS, range_max_m).encode(window, grid)[0] == 0
    hits, passes = images[:PARTS].sum(0), images[PARTS:].sum(0)
    from_robot = grid.centers().reshape(*hit.shape, 2) - scans.poses[-1, :2]
    walls = hit | (continued_walls(hit, grid) & ~seen)
    return Evidence(
        hit=hit,
        seen=seen,
        odds=np.log((passes + 0.5) / (hits + 0.5)),
        hits=np.log1p(hits),
        passes=np.log1p(passes),
        age=np.log1p(scans.ranges.shape[0] - newest),
        to_hit=_log_distance(hit),
        to_passed=_log_distance(seen & ~hit),
        to_robot=np.log1p(np.linalg.norm(from_robot, axis=-1) / grid.resolution_m),
        to_wall=_log_distance(walls),
    )


def evidence_at(case: Case, grid: Grid, pixels: np.ndarray) -> Evidence:
    """Return the evidence of pixels, (P,), and of those around them, (P, 9)."""
    return evidence_of(case.window.scans, grid, case.range_max_m).at(neighbors(pixels, grid.size_px))


def score_map(evidence: Evidence, distance_weight: float, passed_weight: float) -> np.ndarray:
    """Rank last hits below unseen and these below passed pixels, and the pixels of each kind by counts and distances.

    Last hits and passed pixels are ranked by the odds of a pass and the distance to the last hits, unseen pixels by
    the distances to the last hits and to the passed pixels.

    Returns:
        levels from 0, the last hits, to 255, certainly free: unseen pixels from 128 and passed ones from 192 on.
    """
    seen = _scaled(evidence.odds + distance_weight * evidence.to_hit, -3.1, 8.0)
    unseen = _scaled(evidence.to_hit - passed_weight * evidence.to_passed, -5.0, 5.2)
    passed = PASSED_BAND + seen * (LEVELS - PASSED_BAND)
    levels = np.where(evidence.seen, passed, UNSEEN_BAND + unseen * (PASSED_BAND - UNSEEN_BAND))
    return np.where(evidence.hit, seen * UNSEEN_BAND, levels).astype(np.int64)


def fit(evidence: Evidence, free: np.ndarray) -> Pipeline:
    """Fit a logistic regression of free, bool, (P,), on the evidence of pixels and those around them, (P, 9).

    A map is compared by the lowest level within one pixel. So a first regression, on the pixels themselves, tells which
    of the nine decides, and a second one is fitted to these.
    """
    design = evidence.design().reshape(*evidence.hit.shape, -1)
    model = make_pipeline(StandardScaler(), LogisticRegression(solver="newton-cholesky"))
    model.fit(design[:, CENTER], free)
    logit = model.decision_function(design.reshape(-1, design.shape[-1])).reshape(design.shape[:2])
    return model.fit(design[np.arange(len(design)), logit.argmin(1)], free)


def regression_map(evidence: Evidence, model: Pipeline) -> np.ndarray:
    """Rank pixels by a regression; levels are 12 per unit of its logit, and obstacles are below 127.5."""
    logit = model.decision_function(evidence.design()).reshape(evidence.hit.shape)
    return np.clip(np.rint((LEVELS - 1) / 2 + 12 * logit), 0, LEVELS - 1).astype(np.int64)


def continued_walls(hit: np.ndarray, grid: Grid) -> np.ndarray:
    """Continue walls straight on: from each hit along the line through its neighbors, if they lie on one, bool.

    Args:
        hit: pixels with a hit, bool, (H, W).
        grid: grid of the map.
    """
    rows, columns = np.nonzero(hit)
    side = 2 * round(NEIGHBORHOOD_M / grid.resolution_m / 2) + 1
    across = np.arange(len(hit)) - len(hit) / 2  # around zero, for small rounding errors
    y, x = across[:, None], across[None]
    count, *moments = (
        uniform_filter(hit * values, side, mode="constant")[rows, columns] * side**2
        for values in (np.ones_like(hit, float), y, x, y * y, x * x, y * x)
    )
    mean_y, mean_x, yy, xx, yx = (moment / count for moment in moments)
    yy, xx, yx = yy - mean_y**2, xx - mean_x**2, yx - mean_y * mean_x
    half, spread = (yy + xx) / 2, np.hypot((yy - xx) / 2, yx)  # the variances are half - spread and half + spread
    is_wall = (count > 2.5) & (half - spread <= LINEAR * (half + spread))
    angle = np.arctan2(2 * yx, xx - yy)[is_wall] / 2
    steps = np.arange(-WALL_M, WALL_M, grid.resolution_m / 2) / grid.resolution_m
    line = [
        np.rint(start[is_wall, None] + steps * direction[:, None]).astype(int)
        for start, direction in ((rows, np.sin(angle)), (columns, np.cos(angle)))
    ]
    inside = np.all([(each >= 0) & (each < len(hit)) for each in line], axis=0)
    walls = np.zeros_like(hit)
    walls[line[0][inside], line[1][inside]] = True
    return walls


def _log_distance(pixels: np.ndarray) -> np.ndarray:
    """Return the logarithm of the distance to some pixels [px], at least 0; of the whole map where there are none."""
    if not pixels.any():
        return np.full(pixels.shape, np.log(len(pixels)))
    return np.log(np.maximum(distance_transform_edt(~pixels), 1.0))


def _scaled(score: np.ndarray, low: float, high: float) -> np.ndarray:
    """Scale a score to 0 to 0.999."""
    return np.clip((score - low) / (high - low), 0, 0.999)
