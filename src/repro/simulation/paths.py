"""Path of the robot in a world: its start, its random goals, and the check that it keeps clear of fixed obstacles.

In a world, a motion of the robot is a behavior as IR-SIM reads it: its name and its values, with a `direction`.
"""

import math
from typing import Any

import numpy as np
import shapely

from repro.system.errors import InputError
from repro.worlds.robot_motions import FullTurn, Motion, RandomGoals, Square, Waypoints, drive_of, integrated
from repro.worlds.spec import Map

Behavior = dict[str, Any]  # of the robot, as IR-SIM reads it

_GOALS = 200  # goals tried from one place
_STARTS = 50  # starts tried for one world


def planned_path(behavior: Behavior, world: Map) -> np.ndarray:
    """Compute the poses of the robot, beginning with the start, (T + 1, 3)."""
    drive = drive_of(behavior)
    return integrated(drive.commands(world.step_time), drive.start(world.width, world.step_time), world.step_time)


def top_speeds(motion: Motion, step_time: float) -> np.ndarray:
    """Return the largest linear and angular speed of a motion [m/s, rad/s], (2,)."""
    if isinstance(motion, Waypoints):
        return np.array([motion.speed_m_s, motion.turn_rad_s])
    if isinstance(motion, RandomGoals):
        swing_rad_s = motion.standing.turn_rad_s if motion.standing else 0.0
        return np.array([np.max(motion.speed_m_s), max(np.max(motion.turn_rad_s), swing_rad_s)])
    return np.abs(drive_of(_straight(motion)).commands(step_time)).max(axis=0)


def _straight(motion: Motion) -> Behavior:
    """Return a motion in direction 1 that is not turned."""
    return {**motion.irsim(), "turned_rad": 0.0, "direction": 1}


def sampled_behavior(rng: np.random.Generator, motion: Motion) -> Behavior:
    """Return a motion in direction 1 as IR-SIM reads it, with `turned_rad` drawn from its range, if it is one."""
    behavior = {**motion.irsim(), "direction": 1}
    if isinstance(motion, FullTurn | Square) and isinstance(motion.turned_rad, tuple):
        behavior["turned_rad"] = float(rng.uniform(*behavior["turned_rad"]))
    return behavior


def farthest_m(motion: FullTurn | Square, world: Map) -> float:
    """Return the largest distance of the robot from the center of the map [m], however its motion is turned."""
    path = planned_path(_straight(motion), world)[:, :2]
    return float(np.linalg.norm(path - world.width / 2, axis=1).max())


def check_path(
    motion: FullTurn | Square | Waypoints, world: Map, walls: shapely.Geometry | None, radius_m: float
) -> None:
    """Check that a robot stays on the map, for waypoints, and does not touch a fixed obstacle.

    Args:
        motion: a motion without random goals.
        radius_m: radius of the robot [m].

    Raises:
        InputError: it does not.
    """
    points = motion.points_m if isinstance(motion, Waypoints) else []
    for number, (x, y) in enumerate(points, start=1):
        if not (radius_m <= x <= world.width - radius_m and radius_m <= y <= world.height - radius_m):
            raise InputError(
                f"waypoint {number}, [{x:g}, {y:g}], is outside the map of {world.width:g} x {world.height:g} m, "
                f"or nearer to its border than the robot's radius of {radius_m:g} m"
            )
    if walls is None:
        return
    if isinstance(motion, FullTurn | Square) and isinstance(motion.turned_rad, tuple):
        path = shapely.Point(world.width / 2, world.height / 2).buffer(farthest_m(motion, world))
    else:
        path = shapely.LineString(points or planned_path({**motion.irsim(), "direction": 1}, world)[:, :2])
    if shapely.distance(walls, path) < radius_m:
        nearest = shapely.get_coordinates(shapely.shortest_line(walls, path))[1]
        raise InputError(
            f"the robot's path touches a fixed obstacle near [{nearest[0]:.2f}, {nearest[1]:.2f}]: it needs its radius "
            f"of {radius_m:g} m on both sides"
        )


def to_waypoints(
    rng: np.random.Generator, motion: RandomGoals, world: Map, walls: shapely.Geometry | None, radius_m: float
) -> Behavior:
    """Draw a start and random goals on the map, each in sight of the one before, as waypoints for a whole recording.

    Where the motion has robots that stand, it may be a place and a swing instead. A range of `speed_m_s` or
    `turn_rad_s` is drawn first, from a uniform distribution.

    Args:
        walls: fixed obstacles, which the robot passes at its radius or more.
        radius_m: radius of the robot [m].

    Returns:
        the behavior `waypoints`, or `sweep`, in direction 1.

    Raises:
        InputError: there is no free place for a start and a goal.
    """
    size = np.array([world.width, world.height])
    margin_m = max(motion.margin_m or 0.0, radius_m)
    if (2 * margin_m >= size).any():
        raise InputError(f"the robot has no place at {margin_m:g} m or more from the border of a map of {size[0]:g} m")
    low, high = np.full(2, margin_m), size - margin_m
    if motion.standing and rng.random() < motion.standing.share:
        return _sweep(rng, motion, low, high, walls, radius_m)
    given = {**motion.irsim(), "name": "waypoints", "direction": 1}
    given = {key: value for key, value in given.items() if key not in ("margin_m", "standing")}
    given |= {key: float(rng.uniform(*value)) for key, value in given.items() if isinstance(value, list)}
    for _ in range(_STARTS):
        drive = {**given, "points_m": [rng.uniform(low, high).tolist()]}
        while goal := _goal(rng, drive["points_m"][-1], low, high, walls, radius_m):
            drive["points_m"] = [*drive["points_m"], goal]
            if drive_of(drive).commands(world.step_time)[-1].any():  # it still drives in the last step
                return drive
    raise InputError(f"no free place for a robot of radius {radius_m:g} m and its goals: the map is too full")


def _sweep(
    rng, motion: RandomGoals, low: np.ndarray, high: np.ndarray, walls: shapely.Geometry | None, radius_m: float
) -> Behavior:
    """Draw a place, a heading and a swing of a robot that stands."""
    assert motion.standing
    for _ in range(_GOALS):
        place = rng.uniform(low, high)
        if walls is None or shapely.distance(walls, shapely.Point(place)) >= radius_m:
            heading, phase = rng.uniform(-math.pi, math.pi, 2)
            drawn = {
                "swing_rad": rng.uniform(*motion.standing.swing_rad),
                "period_s": rng.uniform(*motion.standing.period_s),
                "phase_rad": phase,
            }
            given = {"name": "sweep", "direction": 1, "steps": motion.steps, "pose": [*place.tolist(), float(heading)]}
            return given | {key: float(value) for key, value in drawn.items()}
    raise InputError(f"no free place for a robot of radius {radius_m:g} m: the map is too full")


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
