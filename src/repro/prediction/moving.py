"""Whether something moves among the hits of a window, which a map may lose once the beams have left it.

A hit is of something that moves if beams had passed over its pixel and those beside it before, and nothing had been
hit there, or if they did so afterwards: it came, or it left. Wrong poses and fine structures make such hits, too, but
alone and in few scans. What moves makes them side by side, again and again.
"""

import numpy as np

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_passed
from repro.scans import Scans, repeats

MOVERS = (
    "something moves, or the poses are wrong: the map may miss it in the view, and does not tell where it is after it "
    "has left the view"
)
PARTS = 20  # of a window, of different scans; something that walks at 1 m/s moves by two pixels in half a second
LAG = 2  # parts, in which something that walks slowly leaves the pixels around a hit
MIN_SHARE, MIN_PARTS = 0.4, 2  # of the parts, with moving pixels, so that something moves
STILL_M, STILL_RAD = 0.01, 0.005  # changes of the pose of a lidar that stands
BESIDE = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))  # the pixel itself, and the four that share a side with it
AROUND = (*BESIDE, (1, 1), (1, -1), (-1, 1), (-1, -1))


def parts_of_window(scans: Scans, grid: Grid, range_max_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels hit and those passed over in each part of a window, bool, (K, H, W).

    A scan that stands for several steps counts once.

    Args:
        scans: one window, (T, N), on the map.
        range_max_m: maximum range of the lidar [m], up to which a miss passes over pixels.
    """
    is_repeated = repeats(np.concatenate([scans.ranges, scans.poses], axis=1))
    different = np.flatnonzero(np.concatenate([[True], ~is_repeated]))
    parts = np.array_split(different, min(PARTS, len(different)))
    index = np.stack([np.pad(part, (0, len(parts[0]) - len(part)), mode="edge") for part in parts])
    batch = Scans(scans.ranges[index], scans.angles, scans.poses[index]).batched()
    return newest_hits(batch, grid) > 0, newest_passed(batch, grid, range_max_m) > 0


def moving_pixels(hits: np.ndarray, passed: np.ndarray, *, is_still: bool) -> np.ndarray:
    """Return the pixels hit by something that moves, bool, (H, W); none if nothing does.

    Args:
        hits: pixels hit in each part of a window, bool, (K, H, W).
        passed: pixels that a beam passed over in each part.
        is_still: the lidar stands, so that the pixel itself decides; poses of one that drives are not exact.
    """
    rows, columns = np.nonzero(hits.any(0))
    hit = hits[:, rows, columns]  # (K, pixels)
    free = np.all(_shifted(passed, rows, columns, BESIDE[:1] if is_still else BESIDE), axis=0)
    near = np.any(_shifted(hits, rows, columns, AROUND), axis=0)
    moving = np.zeros_like(hits)
    moving[:, rows, columns] = _came(hit, free, near) | _came(hit[::-1], free[::-1], near[::-1])[::-1]
    # a wall that is hit here and there, at a flat angle, has single ones
    moves = moving[:, rows, columns] & np.any(_shifted(moving, rows, columns, AROUND[1:]), axis=0)
    found = np.zeros_like(hits[0])
    if moves.any(1).sum() >= max(MIN_PARTS, MIN_SHARE * len(hits)):
        found[rows, columns] = moves.any(0)
    return found


def stands(poses: np.ndarray) -> bool:
    """Return whether a lidar stands in a window, given its poses, (T, 3)."""
    return bool((np.abs(poses - poses[-1]) < (STILL_M, STILL_M, STILL_RAD)).all())


def _shifted(pixels: np.ndarray, rows: np.ndarray, columns: np.ndarray, shifts: tuple) -> np.ndarray:
    """Return the pixels at each shift from some, bool, (shifts, K, pixels); those beyond the map are False."""
    padded = np.pad(pixels, ((0, 0), (1, 1), (1, 1)))
    return np.stack([padded[:, rows + 1 + down, columns + 1 + right] for down, right in shifts])


def _came(hit: np.ndarray, free: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return the hits where a part was free and none had a hit near, `LAG` parts or more before, bool, (K, pixels)."""
    came = np.zeros_like(hit)
    was_free, was_hit = (np.maximum.accumulate(seen, axis=0)[:-LAG] for seen in (free, near))
    came[LAG:] = hit[LAG:] & was_free & ~was_hit
    return came
