"""Path of the robot in a world: its start, its random goals, and the check that it keeps clear of fixed obstacles."""

import math
from typing import Any

import numpy as np
import shapely

from repro.simulation.motions import DRIVES, robot_commands, robot_path
from repro.system.errors import InputError

Motion = dict[str, Any]

_GOALS = 200  # goals tried from one place
_STARTS = 50  # starts tried for one world


def start_pose(motion: Motion, world: dict[str, Any], direction: int) -> list[float]:
    """Return the start pose x, y [m], heading [rad].

    A rotation starts at the center, a square on its left side, `first_steps` before the corner below (direction 1) or
    above (direction -1); `turned_rad` turns both about the center of the map. A drive along waypoints starts at the
    first one; the opposite direction starts where it ends.

    Raises:
        ValueError: the motion is none of these.
    """
    center_x, center_y = world["width"] / 2, world["height"] / 2
    turned_rad = motion.get("turned_rad", 0.0)
    if motion["name"] == "rotate":
        return [center_x, center_y, turned_rad]
    if motion["name"] == "waypoints":
        (x, y), (next_x, next_y) = motion["points_m"][:2]
        start = [float(x), float(y), math.atan2(next_y - y, next_x - x)]
        if direction == 1:
            return start
        x, y, heading = robot_path({**motion, "direction": 1}, start, world["step_time"])[-1].tolist()
        return [x, y, math.remainder(heading + math.pi, 2 * math.pi)]
    if motion["name"] != "square":
        raise InputError(
            f"the motion {motion['name']} of the robot has no start pose: expected rotate, square, waypoints"
        )
    half = motion["side_m"] / 2
    ahead = motion["side_m"] * motion["first_steps"] / motion["drive_steps"]  # [m] to the first corner
    x, y, heading = -half, -direction * (half - ahead), -direction * math.pi / 2
    if turned_rad:
        cos, sin = math.cos(turned_rad), math.sin(turned_rad)
        x, y, heading = cos * x - sin * y, sin * x + cos * y, math.remainder(heading + turned_rad, 2 * math.pi)
    return [center_x + x, center_y + y, heading]


def planned_path(motion: Motion, world: dict[str, Any]) -> np.ndarray:
    """Compute the poses of the robot moving in direction 1, beginning with the start, (T + 1, 3)."""
    return robot_path({**motion, "direction": 1}, start_pose(motion, world, 1), world["step_time"])


def with_sampled_turn(rng: np.random.Generator, motion: Motion) -> Motion:
    """Draw `turned_rad` from its range, if it is one."""
    if not _is_range(motion.get("turned_rad")):
        return motion
    low, high = motion["turned_rad"]
    return {**motion, "turned_rad": float(rng.uniform(low, high))}


def reach_m(motion: Motion, world: dict[str, Any]) -> float:
    """Return the largest distance of the robot from the center of the map [m], however its motion is turned."""
    path = planned_path({**motion, "turned_rad": 0.0}, world)[:, :2]
    return float(np.linalg.norm(path - world["width"] / 2, axis=1).max())


def _is_range(value: Any) -> bool:
    return isinstance(value, list | tuple)


def is_drive(motion: Motion) -> bool:
    """Return whether the robot drives through the map, rather than in a zone around the center."""
    return motion["name"] in DRIVES


def check_path(motion: Motion, world: dict[str, Any], walls: shapely.Geometry | None, radius_m: float) -> None:
    """Check that a robot stays on the map, for waypoints, and does not touch a fixed obstacle.

    Args:
        motion: a motion without random goals.
        world: `world` as IR-SIM reads it.
        walls: the fixed obstacles.
        radius_m: radius of the robot [m].

    Raises:
        ValueError: it does not.
    """
    points = motion.get("points_m", [])
    for number, (x, y) in enumerate(points, start=1):
        if not (radius_m <= x <= world["width"] - radius_m and radius_m <= y <= world["height"] - radius_m):
            raise InputError(
                f"waypoint {number}, [{x:g}, {y:g}], is outside the map of {world['width']:g} x {world['height']:g} m, "
                f"or nearer to its border than the robot's radius of {radius_m:g} m"
            )
        if walls is not None and shapely.distance(walls, shapely.Point(x, y)) < radius_m:
            raise InputError(
                f"waypoint {number}, [{x:g}, {y:g}], is in a fixed obstacle, or nearer to one than the robot's radius "
                f"of {radius_m:g} m"
            )
    if walls is None:
        return
    if _is_range(motion.get("turned_rad")):  # any turn is possible
        path = shapely.Point(world["width"] / 2, world["height"] / 2).buffer(reach_m(motion, world))
    else:
        path = shapely.LineString(points or planned_path(motion, world)[:, :2])
    if shapely.distance(walls, path) < radius_m:
        nearest = shapely.get_coordinates(shapely.shortest_line(walls, path))[1]
        raise InputError(
            f"the robot's path touches a fixed obstacle near [{nearest[0]:.2f}, {nearest[1]:.2f}]: it needs its radius "
            f"of {radius_m:g} m on both sides"
        )


def to_waypoints(
    rng: np.random.Generator, motion: Motion, world: dict[str, Any], walls: shapely.Geometry | None, radius_m: float
) -> Motion:
    """Draw a start and random goals on the map, each in sight of the one before, as waypoints for a whole recording.

    A range of `speed_m_s` or `turn_rad_s` is drawn first, from a uniform distribution.

    Args:
        rng: random stream of the world.
        motion: `random_goals` with its parameters.
        world: `world` as IR-SIM reads it.
        walls: fixed obstacles, which the robot passes at its radius or more.
        radius_m: radius of the robot [m].

    Returns:
        the motion `waypoints`.

    Raises:
        ValueError: there is no free place for a start and a goal.
    """
    size = np.array([world["width"], world["height"]])
    low, high = np.full(2, radius_m), size - radius_m
    ranges = {key: value for key, value in motion.items() if _is_range(value)}
    motion = {**motion, **{key: float(rng.uniform(*value)) for key, value in ranges.items()}}
    for _ in range(_STARTS):
        drive = {**motion, "name": "waypoints", "points_m": [rng.uniform(low, high).tolist()]}
        while goal := _goal(rng, drive["points_m"][-1], low, high, walls, radius_m):
            drive["points_m"] = [*drive["points_m"], goal]
            if _is_long_enough(drive, world["step_time"]):
                return drive
    raise InputError(f"no free place for a robot of radius {radius_m:g} m and its goals: the map is too full")


def _goal(
    rng, place: list[float], low: np.ndarray, high: np.ndarray, walls: shapely.Geometry | None, radius_m: float
) -> list | None:
    """Draw a goal that the robot reaches on a straight way; None if none is found."""
    for _ in range(_GOALS):
        goal = rng.uniform(low, high).tolist()
        way = shapely.LineString([place, goal])
        if way.length >= 2 * radius_m and (walls is None or shapely.distance(walls, way) >= radius_m):
            return goal
    return None


def _is_long_enough(drive: Motion, step_time: float) -> bool:
    """Return whether the robot still drives in the last step of the recording."""
    return bool(robot_commands({**drive, "direction": 1}, step_time)[-1].any())
