"""Predicted maps for the planners of IR-SIM, which take its grid maps (`irsim.world.map.EnvGridMap`)."""

import contextlib
import io
import math
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from repro.prediction.stream import StreamMap
from repro.simulation import behaviors  # noqa: F401  before IR-SIM: silences its import
from repro.system.errors import InputError

# isort: split
from irsim.lib.path_planners.a_star import AStarPlanner
from irsim.world.map import Map


def planner_map(predicted: StreamMap, robot_radius_m: float = 0.0, occupied_above: float = 0.5) -> Map:
    """Convert a predicted map to a grid map of IR-SIM, in which the robot is a point.

    Obstacles are those of the prediction alone: the list of the simulator's own obstacles stays empty.

    Args:
        predicted: the map.
        robot_radius_m: radius by which obstacles grow [m].
        occupied_above: probability of an obstacle above which a cell is occupied.

    Returns:
        a map in the frame of the prediction; its grid is indexed [x, y], 100 is occupied, 0 is free.

    Raises:
        ValueError: a number is outside of its range.
    """
    if not 0 <= robot_radius_m < math.inf or not 0 <= occupied_above < 1:
        raise InputError(
            "expected a robot_radius_m of at least 0 m and occupied_above from 0 to below 1, "
            f"got {robot_radius_m} and {occupied_above}"
        )
    height, width = predicted.free.shape
    is_obstacle = 1 - predicted.free > occupied_above
    if is_obstacle.any():
        is_obstacle = distance_transform_edt(~is_obstacle) * predicted.resolution_m <= robot_radius_m
    return Map(
        width=width * predicted.resolution_m,
        height=height * predicted.resolution_m,
        resolution=predicted.resolution_m,
        grid=100.0 * np.flipud(is_obstacle).T,
        world_offset=predicted.origin,
    )


def plan(grid_map: Map, start: np.ndarray, goal: np.ndarray, planner: Any = AStarPlanner) -> np.ndarray:
    """Plan a path with a planner of IR-SIM.

    Args:
        grid_map: the map, for instance of `planner_map`.
        start: x, y [m].
        goal: x, y [m].
        planner: one of `irsim.lib.path_planners` that takes a map alone.

    Returns:
        x, y [m] from the start to the goal, (P, 2).

    Raises:
        ValueError: the start is outside the map, the goal is outside it or on an obstacle, or there is no path.
    """
    ends = {"start": np.array(start[:2], dtype=float), "goal": np.array(goal[:2], dtype=float)}
    corner, size = np.array(grid_map.world_offset), np.array([grid_map.width, grid_map.height])
    for name, point in ends.items():
        if not ((point >= corner) & (point < corner + size)).all():
            raise InputError(f"the {name} {point} is outside the map, {corner} to {corner + size} m")
    if grid_map.grid_occupied(*ends["goal"]):
        raise InputError(f"the goal {ends['goal']} is on an obstacle")
    with contextlib.redirect_stdout(io.StringIO()):  # where the planners report
        found = planner(grid_map).planning(*ends.values(), show_animation=False)
    if found is None or len(found[0]) < 2:
        raise InputError(f"no path from {ends['start']} to {ends['goal']}")
    return np.array(found).T[::-1]
