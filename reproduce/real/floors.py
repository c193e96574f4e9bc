"""Drives of a simulated lidar through floor plans of real buildings, whose maps are known and not only where beams go.

A floor is a directory with `occ_map.npy`, cells of 0.1 m whose walls are zero, row 0 at the top (uint8). The robot
drives along the shortest path from a random place to the one that is farthest from it, with exact ranges and poses.
Its lidar sees half a turn, cropped to a view as in the logs, so that both truths are known: the floor, and what the
other beams show of it.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter1d, label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from repro.learning.held_out import View, labeled
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.grid import Grid
from repro.prediction.agreement import Observed
from repro.prediction.windows import Window

PLAN = "occ_map.npy"
CELL_M = 0.1
CLEARANCE_M = 0.4  # of the robot's path from walls: doors are 0.9 m wide
SMOOTHED_M, SPEED_M_S, STEP_S = 0.5, 1.0, 0.1
BEAM_SPACING, MARCHED_M = np.radians(1.0), 0.05
WIDE_M, BESIDE_CELLS = 0.6, 3  # known are free space of this width and walls beside it, often drawn as hollow outlines


def is_floor(path: Path) -> bool:
    """Return whether a path is the directory of a floor plan."""
    return (path / PLAN).is_file()


def windows(
    path: Path, settings: WindowSettings, stride: float, grid: Grid, view: View
) -> Iterator[tuple[Window, Observed, Observed]]:
    """Yield the windows of a drive through a floor, with its walls and the free space that the robot can reach.

    The last item is what the beams beside the view show, as in a log.

    Args:
        path: the directory of the floor.
        settings: center and steps of the windows.
        stride: steps between the ends of two windows.
        grid: grid of the maps.
        view: the view of the lidar.
    """
    is_wall = np.load(path / PLAN, allow_pickle=False)[::-1] == 0  # row 0 at the bottom
    from_wall_m = distance_transform_edt(~is_wall) * CELL_M
    areas, _ = label(from_wall_m >= CLEARANCE_M)
    is_clear = areas == 1 + np.argmax(np.bincount(areas.flat)[1:])
    reached, _ = label(~is_wall)
    is_free = reached == reached[tuple(np.argwhere(is_clear)[0])]
    is_free &= distance_transform_edt(from_wall_m < WIDE_M / 2) * CELL_M < WIDE_M / 2
    is_known = binary_dilation(is_free, iterations=BESIDE_CELLS) & (is_free | is_wall)
    marked = [is_known & which for which in (is_wall, is_free)]
    log = driven(is_wall, path_through(is_clear), replace(view, fov_rad=math.pi))
    for window, shown in labeled(log, settings, stride, grid, view):
        places = (grid.centers() + window.origin)[:, ::-1].T.reshape(2, grid.size_px, grid.size_px)
        yield window, Observed(*(_at(which, places) for which in marked)), shown


def path_through(is_clear: np.ndarray) -> np.ndarray:
    """Return the cells, row and column, of the shortest path from a random one of (H, W) to the farthest, (K, 2)."""
    cells = np.argwhere(is_clear)
    number = np.pad(np.full(is_clear.shape, -1), 1, constant_values=-1)
    number[1:-1, 1:-1][is_clear] = np.arange(len(cells))
    edges = []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        beside = np.roll(number, step, axis=(0, 1))
        both = (number >= 0) & (beside >= 0)
        edges.append((number[both], beside[both], np.full(both.sum(), np.hypot(*step))))
    begins, ends, lengths = (np.concatenate(part) for part in zip(*edges, strict=True))
    graph = coo_array((lengths, (begins, ends)), shape=(len(cells),) * 2).tocsr()
    start = np.random.default_rng(0).integers(len(cells))
    far, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    steps = [int(np.argmax(far))]
    while steps[-1] != start:
        steps.append(int(before[steps[-1]]))
    return cells[steps[::-1]]


def driven(is_wall: np.ndarray, path: np.ndarray, view: View) -> ScanLog:
    """Return the log of a robot that drives along cells, (K, 2), with misses beyond the range of the view."""
    places = gaussian_filter1d((path[:, ::-1] + 0.5) * CELL_M, SMOOTHED_M / CELL_M, axis=0, mode="nearest")
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    at = np.arange(0, along[-1], SPEED_M_S * STEP_S)
    x, y = (np.interp(at, along, values) for values in places.T)
    heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    beams = round(view.fov_rad / BEAM_SPACING)
    angles = (np.arange(beams) - (beams - 1) / 2) * BEAM_SPACING
    poses = np.column_stack([x, y, heading])
    ranges = np.stack([cast(is_wall, pose, angles, view.range_max_m) for pose in poses])
    return ScanLog(np.arange(len(at)) * STEP_S, ranges, angles, poses, range_max_m=view.range_max_m)


def cast(is_wall: np.ndarray, pose: np.ndarray, angles: np.ndarray, range_max_m: float) -> np.ndarray:
    """Return the distances to the first wall along beams [m], (N,), float32; a miss is inf."""
    distances = np.arange(MARCHED_M, range_max_m, MARCHED_M)
    directions = np.stack([np.sin(angles + pose[2]), np.cos(angles + pose[2])])  # row, column
    is_hit = _at(is_wall, pose[1::-1, None, None] + directions[..., None] * distances)
    return np.where(is_hit.any(-1), distances[is_hit.argmax(-1)], np.inf).astype(np.float32)


def _at(is_marked: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return whether the cells of a plan (H, W) at places y, x [m], (2, ...), are marked; none is outside of it."""
    cells = (places / CELL_M).astype(int)
    limits = np.array(is_marked.shape).reshape(2, *[1] * (cells.ndim - 1))
    is_inside = ((cells >= 0) & (cells < limits)).all(0)
    return is_inside & is_marked[tuple(cells.clip(0, limits - 1))]
