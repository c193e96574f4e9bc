"""What the scans of a window show of each pixel: the features of maps without a network."""

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, uniform_filter

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.series import Series
from repro.maps.visibility import newest_passed
from repro.scans import Scans

PARTS, LAST = 10, 3  # parts of a window in which hits and passes are counted; newest ones that are told apart
BLURS_PX, LAST_BLURS_PX = (0.7, 1.5, 3.0, 6.0, 12.0), (0.7, 2.0)
ALONG_PX, BEYOND_PX, RAY_SAMPLES = 15, 8, 64  # pixels along a line to both sides; on the ray behind; samples before
NEIGHBORHOOD_M, WALL_M = 1.0, 5.0  # side of the square whose hits give the direction of a wall; how far it is continued
LINEAR = 0.1  # largest ratio of the variances across and along a wall
COUNTS = ("hit", "seen", "odds", "hits", "passes", "age", "to_hit", "to_passed", "to_robot", "to_wall")


class Evidence:
    """What one window, (T, N), on the map shows of its pixels.

    `hit` is a pixel that a beam hit and none passed over later, `seen` one with either. `odds` are those of a pass
    against a hit, from the parts of the window with either; `hits` and `passes` are the parts with a hit and with a
    pass, `age` the steps since it was last seen, `to_hit`, `to_passed`, `to_robot` and `to_wall` the distances to the
    last hits, to pixels that were seen and are no last hits, to the last pose, and to the last hits with straight
    continuations of walls [px]. All but `hit` and `seen` are logarithms.

    Args:
        scans: the window.
        grid: grid of the map.
        range_max_m: maximum range of the lidar [m].
    """

    def __init__(self, scans: Scans, grid: Grid, range_max_m: float) -> None:
        window = scans.batched()
        last_hit = newest_hits(window, grid)[0]
        last_passed = newest_passed(window, grid, range_max_m)[0]
        newest = np.maximum(last_hit, last_passed)
        images = Series(PARTS, range_max_m).encode(window, grid)[0] == 0
        self.hit_parts, self.passed_parts = images[:PARTS].astype(np.float32), images[PARTS:].astype(np.float32)
        hits, passes = self.hit_counts, self.pass_counts = self.hit_parts.sum(0), self.passed_parts.sum(0)
        self.seen, self.hit = newest > 0, (last_hit > 0) & (last_hit >= last_passed)
        offsets = grid.centers().reshape(*self.hit.shape, 2) - scans.poses[-1, :2]
        self.offsets_px, self.heading = offsets / grid.resolution_m, float(scans.poses[-1, 2])
        self.odds = np.log((passes + 0.5) / (hits + 0.5))
        self.hits, self.passes = np.log1p(hits), np.log1p(passes)
        self.age = np.log1p(scans.ranges.shape[0] - newest)
        self.to_hit, self.to_passed = _log_distance(self.hit), _log_distance(self.seen & ~self.hit)
        self.to_robot = np.log1p(np.linalg.norm(self.offsets_px, axis=-1))
        self.to_wall = _log_distance(self.hit | (continued_walls(self.hit, grid) & ~self.seen))

    def counts(self, pixels: np.ndarray) -> np.ndarray:
        """Return the quantities of `COUNTS` at flat indices of pixels, (P,) to (P, 10)."""
        return np.stack([getattr(self, name).ravel()[pixels] for name in COUNTS], axis=1).astype(np.float32)

    def features(self, pixels: np.ndarray) -> np.ndarray:
        """Return all features at flat indices of pixels, (P,) to (P, F): counts, blurs, position, lines, ray."""
        images = [gaussian_filter(image, blur) for image in (self.hit_counts, self.pass_counts) for blur in BLURS_PX]
        for parts in (self.hit_parts, self.passed_parts):
            images += [gaussian_filter(part, blur) for part in parts[-LAST:] for blur in LAST_BLURS_PX]
        columns = [self.counts(pixels), np.stack([image.ravel()[pixels] for image in images], axis=1)]
        columns += [self._position(pixels), self._lines(pixels), self._ray(pixels)]
        return np.concatenate(columns, axis=1).astype(np.float32)

    def _position(self, pixels: np.ndarray) -> np.ndarray:
        """Return the place along and across the heading of the robot [px], and its bearing, (P, 3)."""
        along, across = self._directions()
        offsets = self.offsets_px.reshape(-1, 2)[pixels]
        x, y = offsets @ along, offsets @ across
        return np.stack([x, y, np.arctan2(y, x)], axis=1)

    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        cosine, sine = np.cos(self.heading), np.sin(self.heading)
        return np.array([cosine, sine]), np.array([-sine, cosine])

    def _lines(self, pixels: np.ndarray) -> np.ndarray:
        """Return hits and passes on the lines along and across the heading, to both sides, (P, 16)."""
        columns, steps = [], np.arange(1, ALONG_PX + 1)
        for direction in self._directions():
            for sign in (-1, 1):
                hits, passes, _ = self._sampled(pixels, steps[None, :, None] * (sign * direction))
                nearest = np.where(hits.any(1), (hits > 0).argmax(1), ALONG_PX)
                columns += [hits.max(1), hits.sum(1), nearest, passes.sum(1)]
        return np.stack(columns, axis=1)

    def _ray(self, pixels: np.ndarray) -> np.ndarray:
        """Return hits, unseen and passed pixels on the ray from the robot to a pixel, and hits behind it, (P, 6)."""
        offsets = self.offsets_px.reshape(-1, 2)[pixels][:, None]
        before = np.linspace(-1, 0, RAY_SAMPLES, endpoint=False)[:, None] * offsets
        hits, passes, seen = self._sampled(pixels, before)
        distance = np.linalg.norm(offsets, axis=-1, keepdims=True).clip(1)
        behind, passed_behind, _ = self._sampled(pixels, np.arange(1, BEYOND_PX + 1)[:, None] * offsets / distance)
        shares = [hits.max(1), hits.mean(1) * distance[:, 0, 0], 1 - seen.mean(1), (passes > 0).mean(1)]
        return np.stack([*shares, behind.max(1), passed_behind.mean(1)], axis=1)

    def _sampled(self, pixels: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return parts with a hit, parts with a pass, and whether a pixel was seen, at offsets x, y [px], (P, S)."""
        size = len(self.hit)
        row, column = np.divmod(pixels, size)
        rows = np.rint(row[:, None] - offsets[..., 1]).astype(np.int32)
        columns = np.rint(column[:, None] + offsets[..., 0]).astype(np.int32)
        is_inside = (rows >= 0) & (rows < size) & (columns >= 0) & (columns < size)
        places = np.where(is_inside, rows * size + columns, 0)
        images = self.hit_counts, self.pass_counts, self.seen
        hits, passes, seen = (np.where(is_inside, image.ravel()[places], 0) for image in images)
        return hits, passes, seen


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
