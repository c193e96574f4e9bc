"""Motions of the robot in a file of conf/world, and the commands that they mean.

The commands of a motion are linear and angular velocity of each step [m/s, rad/s], (T, 2), in `direction` 1, or -1 for
the twin. Paper: "Simulation Approach". Unstated details: DEVIATIONS D2 and D3.
"""

import itertools
import math
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from repro.system.errors import InputError
from repro.worlds.limits import (
    Angle,
    Duration,
    Length,
    OneOrRange,
    Part,
    Point,
    Probability,
    Range,
    Speed,
    WindowSteps,
    distinct,
)


class Rotation(Part):
    """A full turn in place, counter-clockwise in direction 1; `turned_rad` [rad] is its start heading, or its range."""

    name: Literal["rotate"]
    steps: WindowSteps
    turned_rad: OneOrRange[Angle] = 0.0

    def commands(self, direction: int, step_time: float) -> np.ndarray:
        return np.tile([0.0, direction * 2 * math.pi / (self.steps * step_time)], (self.steps, 1))

    def start(self, direction: int, size_m: float, step_time: float) -> list[float]:
        """Return the center of the map, as the pose x, y [m], heading [rad]."""
        return [size_m / 2, size_m / 2, self.turned_rad]  # type: ignore[list-item]  # drawn

    def top_speeds(self, step_time: float) -> np.ndarray:
        """Return the largest linear and angular speed [m/s, rad/s], (2,)."""
        return np.abs(self.commands(1, step_time)).max(axis=0)


class Square(Part):
    """A square: along a side to the corner, a quarter turn in place, four times; direction 1 turns left.

    It begins `first_steps` before a corner; half of `drive_steps` is the middle of a side. It is turned about the
    center of the map by `turned_rad` [rad], or by an angle in that range.
    """

    name: Literal["square"]
    side_m: Length
    drive_steps: Annotated[int, Field(ge=1, le=100_000)]
    turn_steps: Annotated[int, Field(ge=1, le=100_000)]
    first_steps: Annotated[int, Field(ge=0)]
    turned_rad: OneOrRange[Angle] = 0.0

    @property
    def steps(self) -> int:
        return 4 * (self.drive_steps + self.turn_steps)

    def commands(self, direction: int, step_time: float) -> np.ndarray:
        """Compute the commands.

        Raises:
            InputError: first_steps is longer than a side.
        """
        first, side = self.first_steps, self.drive_steps
        if not 0 <= first <= side:
            raise InputError(f"first_steps must be between 0 and drive_steps={side}, got {first}")
        drive = np.tile([self.side_m / (side * step_time), 0.0], (side, 1))
        turn = np.tile([0.0, direction * math.pi / 2 / (self.turn_steps * step_time)], (self.turn_steps, 1))
        return np.tile(np.concatenate([drive[:first], turn, drive[first:]]), (4, 1))

    def start(self, direction: int, size_m: float, step_time: float) -> list[float]:
        """Return the start on the left side, before the corner below (direction 1) or above (-1), then turned."""
        center, half, turned = size_m / 2, self.side_m / 2, float(self.turned_rad)  # type: ignore[arg-type]  # drawn
        ahead = self.side_m * self.first_steps / self.drive_steps  # [m] to the first corner
        x, y, heading = -half, -direction * (half - ahead), -direction * math.pi / 2
        if turned:
            cos, sin = math.cos(turned), math.sin(turned)
            x, y, heading = cos * x - sin * y, sin * x + cos * y, math.remainder(heading + turned, 2 * math.pi)
        return [center + x, center + y, heading]

    def top_speeds(self, step_time: float) -> np.ndarray:
        return np.abs(self.commands(1, step_time)).max(axis=0)


class Waypoints(Part):
    """A drive along given points: a turn in place toward the next one, then straight ahead.

    The robot starts at the first point, heading for the second. Each turn and each way takes the least number of equal
    steps within the given speeds. A drive that is longer than `steps` ends on the way; after a shorter one the robot
    stands still. Direction -1 drives from the end of the drive back to the first point.
    """

    name: Literal["waypoints"]
    points_m: Annotated[list[Point], Field(min_length=2, max_length=1000), AfterValidator(distinct)]
    speed_m_s: Speed
    turn_rad_s: Speed
    steps: WindowSteps

    def commands(self, direction: int, step_time: float) -> np.ndarray:
        parts: list[np.ndarray] = []
        heading, length = None, 0
        for (x0, y0), (x1, y1) in itertools.pairwise(self.points_m):
            if length >= self.steps:
                break
            ahead, way_m = math.atan2(y1 - y0, x1 - x0), math.hypot(x1 - x0, y1 - y0)
            turn = 0.0 if heading is None else math.remainder(ahead - heading, 2 * math.pi)
            heading = ahead
            parts += [_evenly(turn, self.turn_rad_s, step_time, column=1)]
            parts += [_evenly(way_m, self.speed_m_s, step_time, column=0)]
            length += len(parts[-2]) + len(parts[-1])
        commands = np.concatenate([*parts, np.zeros((self.steps, 2))])[: self.steps]
        return commands if direction == 1 else commands[::-1] * [1, -1]

    def start(self, direction: int, size_m: float, step_time: float) -> list[float]:
        """Return the first point; the opposite direction starts where the drive ends."""
        (x, y), (next_x, next_y) = self.points_m[:2]
        start = [float(x), float(y), math.atan2(next_y - y, next_x - x)]
        if direction == 1:
            return start
        x, y, heading = integrated(self.commands(1, step_time), start, step_time)[-1].tolist()
        return [x, y, math.remainder(heading + math.pi, 2 * math.pi)]

    def top_speeds(self, step_time: float) -> np.ndarray:
        return np.array([self.speed_m_s, self.turn_rad_s])


class Sweep(Part):
    """A robot that stands at a pose and swings its view about its heading, as a sine; no motion of conf/world.

    A swing to both sides has an amplitude of `swing_rad` [rad] and takes `period_s` [s]; it begins at `phase_rad`.
    """

    name: Literal["sweep"]
    pose: list[float]
    swing_rad: float
    period_s: float
    phase_rad: float
    steps: int

    def commands(self, direction: int, step_time: float) -> np.ndarray:
        phases = self.phase_rad + 2 * math.pi * np.arange(self.steps + 1) * step_time / self.period_s
        turn = direction * self.swing_rad * np.diff(np.sin(phases)) / step_time
        return np.stack([np.zeros(self.steps), turn], axis=1)

    def start(self, direction: int, size_m: float, step_time: float) -> list[float]:
        return list(self.pose)


class Standing(Part):
    """A robot that stands, at any place and heading, and swings its view by `swing_rad` [rad] in `period_s` [s]."""

    share: Probability
    swing_rad: Range[Annotated[float, Field(ge=0, le=math.pi, allow_inf_nan=False)]]
    period_s: Range[Duration]

    @property
    def turn_rad_s(self) -> float:
        """The largest rate of turn [rad/s]."""
        return 2 * math.pi * self.swing_rad[1] / self.period_s[0]


class RandomGoals(Part):
    """Straight drives to random goals, with turns in place; a range of speeds is sampled once per world.

    In a part of the worlds, the robot stands. It keeps `margin_m` from the border of the map [m], at least its radius.
    """

    name: Literal["random_goals"]
    speed_m_s: OneOrRange[Speed]
    turn_rad_s: OneOrRange[Speed]
    steps: WindowSteps
    margin_m: Length | None = None
    standing: Standing | None = None

    def top_speeds(self, step_time: float) -> np.ndarray:
        swing_rad_s = self.standing.turn_rad_s if self.standing else 0.0
        return np.array([np.max(self.speed_m_s), max(np.max(self.turn_rad_s), swing_rad_s)])


Motion = Annotated[Rotation | Square | Waypoints | RandomGoals, Field(discriminator="name")]


def _evenly(amount: float, rate: float, step_time: float, column: int) -> np.ndarray:
    """Divide a way [m] or a turn [rad] into the least number of equal steps at no more than `rate`, (S, 2)."""
    steps = math.ceil(abs(amount) / (rate * step_time) - 1e-9)
    commands = np.zeros((steps, 2))
    if steps:
        commands[:, column] = amount / (steps * step_time)
    return commands


def integrated(commands: np.ndarray, start: list[float], step_time: float) -> np.ndarray:
    """Integrate commands from a start x, y [m], heading [rad]; return the poses, beginning with it, (T + 1, 3)."""
    speed, turn = commands.T
    heading = start[2] + np.concatenate([[0], np.cumsum(turn * step_time)])
    moves = speed * step_time * np.stack([np.cos(heading[:-1]), np.sin(heading[:-1])])
    position = np.array(start[:2])[:, None] + np.pad(np.cumsum(moves, axis=1), ((0, 0), (1, 0)))
    return np.stack([*position, heading], axis=1)
