"""Episodes: many robots drive their courses step by step, all with one mapper and one planner.

A step is one of IR-SIM: its differential kinematics for the robots, the motions of the obstacles, then a scan with its
ray equations. A robot turns once on the spot, which fills a window; then it gets a map and a command every `EVERY`
steps. Obstacles ignore the robots.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from repro.maps.grid import Grid
from repro.maps.outlines import padded, placed
from repro.navigation.courses import LIMIT_STEPS, TURN_STEPS, Course
from repro.navigation.mappers import Mapper, Seen
from repro.navigation.planner import Planner, Settings
from repro.scans import wrapped
from repro.simulation.raycasting import scan
from repro.simulation.simulator import beam_angles
from repro.worlds.spec import WorldSpec

EVERY = 5  # steps from one map and command to the next
REACHED_M = 1.0  # distance to a goal at which it counts as reached
FAR_M = 3.0  # up to which the clearance is measured
FAR_AWAY_M = 1e6  # where courses with fewer obstacles have the others


@dataclass(frozen=True)
class Episode:
    """How one robot fared.

    Args:
        seed: number of the course.
        obstacles: their number.
        outcome: `goal`, `collision` or `timeout`.
        time_s: from the end of the first turn [s].
        speed_m_s: largest speed of the robot [m/s].
        path_m: length of the path [m].
        way_m: length of the straight ways between the goals [m].
        clearance_m: least distance of the robot's center to an outline, at most `FAR_M` [m].
        moving_share: share of the time in which the robot drove.
        contact: where an obstacle touched the robot: `in view` of its lidar, `beside` it, `behind` it (the quarter
            turn opposite to its heading); empty without a collision.
        stood: whether the robot stood when it was hit.
    """

    seed: int
    obstacles: int
    outcome: str
    time_s: float
    speed_m_s: float
    path_m: float
    way_m: float
    clearance_m: float
    moving_share: float
    contact: str
    stood: bool


class Fleet:
    """The robots of a batch of courses, in the order of the courses.

    Args:
        spec: the worlds of the courses.
        courses: E courses.
        mapper: how the robots make maps.
        settings: values of the settings of the mapper and of the planner for each course.
        grid: grid of the maps.
    """

    def __init__(
        self,
        spec: WorldSpec,
        courses: Sequence[Course],
        mapper: Mapper,
        settings: Sequence[Mapping[str, Any]],
        grid: Grid,
    ) -> None:
        robot, lidar = spec.robot.irsim(), spec.lidar.irsim()
        self.step_s, self.range_max_m = spec.world.step_time, spec.lidar.range_max
        self.radius_m = robot["shape"]["radius"]
        self.half_view = lidar["angle_range"] / 2
        if mapper.lidar == "circle":  # the same spacing of the beams
            number = round(2 * math.pi / lidar["angle_range"] * (lidar["number"] - 1))
            lidar |= {"angle_range": 2 * math.pi * (1 - 1 / number), "number": number}
        self.angles = beam_angles(lidar)
        self.courses, self.mapper, self.speed_m_s = courses, mapper, float(robot["vel_max"][0])
        of_robot = self.radius_m, *map(float, robot["vel_max"])
        self.groups: list[tuple[np.ndarray, Planner, dict[str, Any]]] = []
        for own in [dict(items) for items in dict.fromkeys(tuple(each.items()) for each in settings)]:
            planned = {field.name: own.pop(field.name) for field in fields(Settings) if field.name in own}
            those = [index for index, each in enumerate(settings) if each == own | planned]
            self.groups.append((np.array(those), Planner(grid, Settings(**planned), *of_robot), own))
        self.outlines, self.obstacles = _stacked(courses)
        forgetting = np.array([each.get("forgetting", np.nan) for each in settings], dtype=np.float32)
        self.seen = Seen(courses, self.obstacles, grid, self.angles, self.range_max_m, self.step_s, forgetting)
        self.radii = np.linalg.norm(self.outlines, axis=-1).max(-1)  # (O, E)
        self.poses = np.array([course.start for course in courses])
        self.goal = np.zeros(len(courses), dtype=int)
        self.commands = np.tile([0.0, 2 * math.pi / (TURN_STEPS * self.step_s)], (len(courses), 1))
        self.path_m, self.moving_steps = np.zeros((2, len(courses)))
        self.clearance_m = np.full(len(courses), FAR_M)
        self.episodes: dict[int, Episode] = {}

    def drive(self) -> list[Episode]:
        """Drive all courses to their ends, step by step, counted from 1."""
        for step in range(1, TURN_STEPS + LIMIT_STEPS + 1):
            who = np.array([index for index in range(len(self.courses)) if index not in self.episodes])
            if not len(who):
                break
            if step > TURN_STEPS and (step - TURN_STEPS - 1) % EVERY == 0:
                self._plan(who)
            self._move(who, step)
        for index in set(range(len(self.courses))) - set(self.episodes):
            self._end(index, "timeout", TURN_STEPS + LIMIT_STEPS)
        return [self.episodes[index] for index in range(len(self.courses))]

    def _plan(self, who: np.ndarray) -> None:
        """Command the robots that still drive, those with the same settings together."""
        for group, planner, settings in self.groups:
            own = np.intersect1d(group, who)
            if not len(own):
                continue
            occupied = self.mapper.maps(self.seen, own, **settings)
            goals = np.array([self.courses[index].goals[self.goal[index]] for index in own])
            self.commands[own] = planner.plan(occupied, self.poses[own], goals)

    def _move(self, who: np.ndarray, step: int) -> None:
        """Move the robots, end the episodes that are over, and scan."""
        self.poses[who] = moved(self.poses[who], self.commands[who], self.step_s)
        if step > TURN_STEPS:
            self.path_m[who] += np.abs(self.commands[who, 0]) * self.step_s
            self.moving_steps[who] += self.commands[who, 0] != 0
        outlines, obstacles = self.outlines[:, who], self.obstacles[:, who, step]
        distance, contact = nearest(self.poses[who, :2], outlines, obstacles, self.radii[:, who])
        self.clearance_m[who] = np.minimum(self.clearance_m[who], distance)
        for index, touched, point in zip(who, distance < self.radius_m, contact, strict=True):
            if touched:
                self._end(index, "collision", step, point)
            elif np.hypot(*(self.courses[index].goals[self.goal[index]] - self.poses[index, :2])) < REACHED_M:
                self.goal[index] += 1
                if self.goal[index] == len(self.courses[index].goals):
                    self._end(index, "goal", step)
        if not self.episodes.keys().isdisjoint(who):
            going = np.array([index not in self.episodes for index in who])
            who, obstacles, outlines = who[going], obstacles[:, going], outlines[:, going]
        if self.mapper.lidar == "none":
            self.seen.step = step
        elif len(who):
            ranges, _ = scan(self.poses[who], self.angles, outlines, obstacles, self.range_max_m)
            self.seen.add(who, ranges.astype(np.float32), self.poses[who])

    def _end(self, index: int, outcome: str, step: int, contact: np.ndarray | None = None) -> None:
        course, pose = self.courses[index], self.poses[index]
        place, driven = "", max(step - TURN_STEPS, 0)
        if contact is not None:
            x, y = contact - pose[:2]
            bearing = abs(wrapped(math.atan2(y, x) - pose[2]))
            place = "in view" if bearing <= self.half_view else "behind" if bearing >= 3 * math.pi / 4 else "beside"
        self.episodes[index] = Episode(
            course.seed,
            len(course.outlines),
            outcome,
            driven * self.step_s,
            self.speed_m_s,
            float(self.path_m[index]),
            course.way_m,
            float(self.clearance_m[index]),
            float(self.moving_steps[index] / max(driven, 1)),
            place,
            outcome == "collision" and bool(self.commands[index, 0] == 0),
        )


def moved(poses: np.ndarray, commands: np.ndarray, step_s: float) -> np.ndarray:
    """Compute the next poses of robots, (E, 3), as IR-SIM's differential kinematics does."""
    speed, turn = commands.T
    step = np.stack([speed * np.cos(poses[:, 2]), speed * np.sin(poses[:, 2]), turn], axis=1)
    new = poses + step * step_s
    return np.column_stack([new[:, :2], wrapped(new[:, 2])])


def nearest(
    points: np.ndarray, outlines: np.ndarray, states: np.ndarray, radii: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the nearest point of the outlines around each of E points.

    Args:
        points: x, y [m], (E, 2), all outside of the obstacles.
        outlines: outlines in their own frames [m], (O, E, V, 2).
        states: x, y [m], heading [rad] of the obstacles, (O, E, 3).
        radii: of the circles around the outlines [m], (O, E).

    Returns:
        distance [m], at most `FAR_M`, (E,), and the point, (E, 2).
    """
    which, robot = np.nonzero(np.linalg.norm(states[..., :2] - points, axis=-1) < radii + FAR_M)
    rings = placed(outlines[which, robot], states[which, robot])  # (K, V, 2)
    edges = np.roll(rings, -1, axis=1) - rings
    away = points[robot, None] - rings
    share = (away * edges).sum(-1) / np.maximum((edges**2).sum(-1), 1e-12)
    feet = rings + np.clip(share, 0, 1)[..., None] * edges
    gaps = np.linalg.norm(points[robot, None] - feet, axis=-1)
    best = gaps.argmin(1)
    distance, foot = np.full(len(points), FAR_M), np.array(points)
    for index, gap, point in zip(robot, gaps.min(1), feet[np.arange(len(best)), best], strict=True):
        if gap < distance[index]:
            distance[index], foot[index] = gap, point
    return distance, foot


def _stacked(courses: Sequence[Course]) -> tuple[np.ndarray, np.ndarray]:
    """Return the outlines (O, E, V, 2) and the states (O, E, S + 1, 3) of the obstacles of E courses."""
    most = max(len(course.outlines) for course in courses)
    longest = max(course.outlines.shape[1] for course in courses)
    outlines = [_filled(padded(course.outlines, longest), most) for course in courses]
    states = [_filled(course.states, most, FAR_AWAY_M) for course in courses]
    return np.stack(outlines, axis=1), np.stack(states, axis=1)


def _filled(values: np.ndarray, count: int, value: float = 0.0) -> np.ndarray:
    """Append rows of a value to an array, up to `count`."""
    rest = np.full((count - len(values), *values.shape[1:]), value)
    return np.concatenate([values, rest])
