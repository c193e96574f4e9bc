"""Recency: time since each pixel was last seen and each obstacle last hit, computed from the recording.

Ages count steps back from the end of the recording; the last step has age 1. A pixel that was within field of view and
range but always hidden is `occluded`; one that never was is `never in view`."""

import numpy as np
import shapely

from repro.maps.grid import Grid
from repro.maps.ground_truth import areas_of, rasterize
from repro.maps.visibility import newest_in_view, newest_visible
from repro.recordings.format import ShardContent
from repro.scans import Scans

LATER = (11, 26, 51)  # first ages of the groups after the first one [steps]
RECENCY = ("1-10", "11-25", "26-50", "51-100", "occluded", "never in view")  # groups of pixels; the fourth has no end
OCCLUDED, NEVER_IN_VIEW = 4, 5
TOUCH_M = 0.02  # largest distance of a hit from its obstacle; ranges are stored as float32


def pixel_groups(scans: Scans, grid: Grid, range_max_m: float) -> np.ndarray:
    """Group the pixels by the time since they were last visible.

    Args:
        scans: windows of scans, (B, T, N).
        range_max_m: length of a beam without a hit [m].

    Returns:
        the index in `RECENCY` of the group of each pixel, uint8, (B, H, W).
    """
    windows = scans.batched()
    half = grid.resolution_m / 2  # the margin makes a hit surface visible
    visible = newest_visible(windows, grid, range_max_m, margin_m=half)
    in_view = newest_in_view(windows, grid, range_max_m)
    group = age_group(windows.ranges.shape[1] - visible + 1)
    return np.where(visible > 0, group, np.where(in_view > 0, OCCLUDED, NEVER_IN_VIEW)).astype(np.uint8)


def age_group(age: np.ndarray) -> np.ndarray:
    """Return the index in `RECENCY` of the group of ages in steps, which start at 1."""
    return np.digitize(age, LATER)


def newest_hits_of_obstacles(shard: ShardContent, noise_m: float = 0.0) -> np.ndarray:
    """Compute the newest step at which each obstacle was hit, in both recordings of its world.

    Args:
        shard: recordings of R / 2 worlds with K obstacles in total.
        noise_m: standard deviation of the ranges [m]; hits count up to three times as far from an obstacle.

    Returns:
        the step, counted from 1, or 0 for never, (2, K); the first row is of direction 1, the second of -1.
    """
    points, hit = shard.scans.batched(np.float64).points()
    newest = np.zeros((2, len(shard.world)), dtype=np.int64)
    areas, near_m = np.abs(areas_of(shard.outlines)), TOUCH_M + 3 * noise_m
    hulls = shapely.area(shapely.convex_hull(shapely.linestrings(shard.outlines.astype(float))))
    is_convex = (hulls > 0) & (hulls <= (1 + 1e-6) * areas)  # outlines are stored with 24 bits
    for number, world in enumerate(shard.world):
        outline, states = shard.outlines[number].astype(float), shard.states[number].astype(float)
        closed = np.concatenate([outline, outline[:1]])
        shape = shapely.polygons(closed) if is_convex[number] else shapely.linestrings(closed)
        shapely.prepare(shape)
        for twin in (0, 1):
            steps = _steps_touching(points[2 * world + twin], hit[2 * world + twin], shape, states, near_m)
            newest[twin, number] = steps.max(initial=-1) + 1
    return newest


def _steps_touching(
    points: np.ndarray, hit: np.ndarray, shape: shapely.Geometry, states: np.ndarray, near_m: float
) -> np.ndarray:
    """Return the steps at which any point (T, N, 2) that is a hit (T, N) is near a shape with states (T, 3)."""
    offset = points - states[:, None, :2]
    radius = np.linalg.norm(shapely.get_coordinates(shape), axis=-1).max()
    step, beam = np.nonzero(hit & (np.linalg.norm(offset, axis=-1) <= radius + near_m))
    cos, sin = np.cos(states[step, 2]), np.sin(states[step, 2])
    x, y = offset[step, beam].T
    own = shapely.points(x * cos + y * sin, y * cos - x * sin)  # in the obstacle's frame
    return step[shapely.dwithin(shape, own, near_m)]


def obstacle_masks(shard: ShardContent, grid: Grid) -> np.ndarray:
    """Draw each single obstacle at the last step, bool, (K, H, W)."""
    number = len(shard.world)
    return rasterize(shard.outlines, shard.states[:, -1], np.arange(number), number, grid) == 0
