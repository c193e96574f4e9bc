"""Path of the robot in a world: its start, its random goals, and the check that it keeps clear of fixed obstacles."""

import math
from typing import Any

import numpy as np
import shapely

from repro.simulation.motions import robot_commands, robot_path
from repro.system.errors import InputError
from repro.world_config import Map
from repro.world_motions import Motion, RandomGoals, Rotation, Square, Waypoints

Behavior = dict[str, Any]  # of the robot, as IR-SIM reads it

_GOALS = 200  # goals tried from one place
_STARTS = 50  # starts tried for one world


def start_pose(behavior: Behavior, size_m: float, step_time: float) -> list[float]:
    """Return the start pose x, y [m], heading [rad].

    A rotation starts at the center, a square on its left side, `first_steps` before the corner below (direction 1) or
    above (direction -1); `turned_rad` turns both about the center of the map. A drive along waypoints starts at the
    first one; the opposite direction starts where it ends. A sweep starts at its `pose`.

    Args:
        behavior: as written in a world YAML.
        size_m: side of the map [m].
        step_time: duration of a step [s].

    Raises:
        ValueError: the behavior is none of these.
    """
    center, direction, turned_rad = size_m / 2, behavior["direction"], behavior.get("turned_rad", 0.0)
    if behavior["name"] == "rotate":
        return [center, center, turned_rad]
    if behavior["name"] == "sweep":
        return list(behavior["pose"])
    if behavior["name"] == "waypoints":
        (x, y), (next_x, next_y) = behavior["points_m"][:2]
        start = [float(x), float(y), math.atan2(next_y - y, next_x - x)]
        if direction == 1:
            return start
        x, y, heading = robot_path({**behavior, "direction": 1}, start, step_time)[-1].tolist()
        return [x, y, math.remainder(heading + math.pi, 2 * math.pi)]
    if behavior["name"] != "square":
        raise InputError(
            f"the motion {behavior['name']} of the robot has no start pose: expected rotate, square, waypoints, sweep"
        )
    half = behavior["side_m"] / 2
    ahead = behavior["side_m"] * behavior["first_steps"] / behavior["drive_steps"]  # [m] to the first corner
    x, y, heading = -half, -direction * (half - ahead), -direction * math.pi / 2
    if turned_rad:
        cos, sin = math.cos(turned_rad), math.sin(turned_rad)
        x, y, heading = cos * x - sin * y, sin * x + cos * y, math.remainder(heading + turned_rad, 2 * math.pi)
    return [center + x, center + y, heading]


def planned_path(behavior: Behavior, world: Map) -> np.ndarray:
    """Compute the poses of the robot, beginning with the start, (T + 1, 3)."""
    return robot_path(behavior, start_pose(behavior, world.width, world.step_time), world.step_time)


def sampled_behavior(rng: np.random.Generator, motion: Motion) -> Behavior:
    """Return a motion in direction 1 as IR-SIM reads it, with `turned_rad` drawn from its range, if it is one."""
    behavior = {**motion.irsim(), "direction": 1}
    if _may_turn(motion):
        behavior["turned_rad"] = float(rng.uniform(*behavior["turned_rad"]))
    return behavior


def reach_m(motion: Rotation | Square, world: Map) -> float:
    """Return the largest distance of the robot from the center of the map [m], however its motion is turned."""
    path = planned_path({**motion.irsim(), "turned_rad": 0.0, "direction": 1}, world)[:, :2]
    return float(np.linalg.norm(path - world.width / 2, axis=1).max())


def _may_turn(motion: Motion) -> bool:
    return isinstance(motion, Rotation | Square) and isinstance(motion.turned_rad, tuple)


def check_path(
    motion: Rotation | Square | Waypoints, world: Map, walls: shapely.Geometry | None, radius_m: float
) -> None:
    """Check that a robot stays on the map, for waypoints, and does not touch a fixed obstacle.

    Args:
        motion: a motion without random goals.
        world: the map.
        walls: the fixed obstacles.
        radius_m: radius of the robot [m].

    Raises:
        ValueError: it does not.
    """
    points = motion.points_m if isinstance(motion, Waypoints) else []
    for number, (x, y) in enumerate(points, start=1):
        if not (radius_m <= x <= world.width - radius_m and radius_m <= y <= world.height - radius_m):
            raise InputError(
                f"waypoint {number}, [{x:g}, {y:g}], is outside the map of {world.width:g} x {world.height:g} m, "
                f"or nearer to its border than the robot's radius of {radius_m:g} m"
            )
        if walls is not None and shapely.distance(walls, shapely.Point(x, y)) < radius_m:
            raise InputError(
                f"waypoint {number}, [{x:g}, {y:g}], is in a fixed obstacle, or nearer to one than the robot's radius "
                f"of {radius_m:g} m"
            )
    if walls is None:
        return
    if isinstance(motion, Rotation | Square) and _may_turn(motion):
        path = shapely.Point(world.width / 2, world.height / 2).buffer(reach_m(motion, world))
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
        rng: random stream of the world.
        motion: speeds and steps.
        world: the map.
        walls: fixed obstacles, which the robot passes at its radius or more.
        radius_m: radius of the robot [m].

    Returns:
        the behavior `waypoints`, or `sweep`, in direction 1.

    Raises:
        ValueError: there is no free place for a start and a goal.
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
            if robot_commands(drive, world.step_time)[-1].any():  # it still drives in the last step
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
