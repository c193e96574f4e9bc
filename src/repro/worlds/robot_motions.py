"""Motions of the robot: their parameters in a file of conf/world, and the drives that they become in a world.

A drive has the values of a `behavior` as IR-SIM reads it; direction -1 is that of the twin. Its `commands` are linear
and angular velocity of each of its `steps` [m/s, rad/s], (T, 2), given the time of a step [s]; its `start` is the pose
x, y [m], heading [rad] on a map of some side [m]. Paper: "Simulation Approach". Unstated details: DEVIATIONS D2, D3.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from repro.system.errors import InputError
from repro.worlds.limits import (
    Angle,
    Duration,
    Length,
    OneOrRange,
    Point,
    Probability,
    Range,
    Section,
    Speed,
    WindowSteps,
    distinct,
)

Steps = Annotated[int, Field(ge=1, le=100_000)]  # of a side or a turn


class FullTurn(Section):
    """A full turn in place; `turned_rad` [rad] is its start heading, or its range."""

    name: Literal["rotate"]
    steps: WindowSteps
    turned_rad: OneOrRange[Angle] = 0.0


@dataclass(frozen=True)
class RotationDrive:
    """A full turn at the center of the map, counter-clockwise in direction 1."""

    direction: int
    steps: int
    turned_rad: float = 0.0

    def commands(self, step_time: float) -> np.ndarray:
        return np.tile([0.0, self.direction * 2 * math.pi / (self.steps * step_time)], (self.steps, 1))

    def start(self, size_m: float, step_time: float) -> list[float]:
        return [size_m / 2, size_m / 2, self.turned_rad]


class Square(Section):
    """A square, which begins `first_steps` before a corner; half of `drive_steps` is the middle of a side.

    It is turned about the center of the map by `turned_rad` [rad], or by an angle in that range.
    """

    name: Literal["square"]
    side_m: Length
    drive_steps: Steps
    turn_steps: Steps
    first_steps: Annotated[int, Field(ge=0)]
    turned_rad: OneOrRange[Angle] = 0.0

    @model_validator(mode="after")
    def _begins_on_a_side(self) -> "Square":
        if self.first_steps > self.drive_steps:
            raise InputError(f"first_steps must be between 0 and drive_steps={self.drive_steps}")
        return self

    @property
    def steps(self) -> int:
        return 4 * (self.drive_steps + self.turn_steps)


@dataclass(frozen=True)
class SquareDrive:
    """Along a side to the corner, a quarter turn in place, four times; direction 1 turns left."""

    direction: int
    side_m: float
    drive_steps: int
    turn_steps: int
    first_steps: int
    turned_rad: float = 0.0

    @property
    def steps(self) -> int:
        return 4 * (self.drive_steps + self.turn_steps)

    def commands(self, step_time: float) -> np.ndarray:
        first, side = self.first_steps, self.drive_steps
        drive = np.tile([self.side_m / (side * step_time), 0.0], (side, 1))
        turn = np.tile([0.0, self.direction * math.pi / 2 / (self.turn_steps * step_time)], (self.turn_steps, 1))
        return np.tile(np.concatenate([drive[:first], turn, drive[first:]]), (4, 1))

    def start(self, size_m: float, step_time: float) -> list[float]:
        """Return the start on the left side, before the corner below (direction 1) or above (-1), then turned."""
        center, half, direction = size_m / 2, self.side_m / 2, self.direction
        ahead = self.side_m * self.first_steps / self.drive_steps  # [m] to the first corner
        x, y, heading = -half, -direction * (half - ahead), -direction * math.pi / 2
        if self.turned_rad:
            cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
            x, y = cos * x - sin * y, sin * x + cos * y
            heading = math.remainder(heading + self.turned_rad, 2 * math.pi)
        return [center + x, center + y, heading]


class Waypoints(Section):
    """A drive along given points: a turn in place toward the next one, then straight ahead."""

    name: Literal["waypoints"]
    points_m: Annotated[list[Point], Field(min_length=2, max_length=1000), AfterValidator(distinct)]
    speed_m_s: Speed
    turn_rad_s: Speed
    steps: WindowSteps


@dataclass(frozen=True)
class WaypointDrive:
    """A drive that starts at the first point, heading for the second.

    Each turn and each way takes the least number of equal steps within the given speeds. A drive that is longer than
    `steps` ends on the way; after a shorter one the robot stands still. Direction -1 drives from the end of the drive
    back to the first point.
    """

    direction: int
    points_m: list[list[float]]
    speed_m_s: float
    turn_rad_s: float
    steps: int

    def commands(self, step_time: float) -> np.ndarray:
        commands = self._commands_ahead(step_time)
        return commands if self.direction == 1 else commands[::-1] * [1, -1]

    def _commands_ahead(self, step_time: float) -> np.ndarray:
        parts: list[np.ndarray] = []
        heading = None
        for (x0, y0), (x1, y1) in itertools.pairwise(self.points_m):
            if sum(map(len, parts)) >= self.steps:
                break
            ahead, way_m = math.atan2(y1 - y0, x1 - x0), math.hypot(x1 - x0, y1 - y0)
            turn = 0.0 if heading is None else math.remainder(ahead - heading, 2 * math.pi)
            heading = ahead
            parts += [_evenly(turn, self.turn_rad_s, step_time, 1), _evenly(way_m, self.speed_m_s, step_time, 0)]
        return np.concatenate([*parts, np.zeros((self.steps, 2))])[: self.steps]

    def start(self, size_m: float, step_time: float) -> list[float]:
        """Return the first point; the opposite direction starts where the drive ends."""
        (x, y), (next_x, next_y) = self.points_m[:2]
        start = [float(x), float(y), math.atan2(next_y - y, next_x - x)]
        if self.direction == 1:
            return start
        x, y, heading = integrated(self._commands_ahead(step_time), start, step_time)[-1].tolist()
        return [x, y, math.remainder(heading + math.pi, 2 * math.pi)]


class Standing(Section):
    """A robot that stands, at any place and heading, and swings its view by `swing_rad` [rad] in `period_s` [s]."""

    share: Probability
    swing_rad: Range[Annotated[float, Field(ge=0, le=math.pi, allow_inf_nan=False)]]
    period_s: Range[Duration]

    @property
    def turn_rad_s(self) -> float:
        """The largest rate of turn [rad/s]."""
        return 2 * math.pi * self.swing_rad[1] / self.period_s[0]


@dataclass(frozen=True)
class SweepDrive:
    """A robot that stands at a pose and swings its view about its heading, as a sine.

    A swing to both sides has an amplitude of `swing_rad` [rad] and takes `period_s` [s]; it begins at `phase_rad`.
    """

    direction: int
    pose: list[float]
    swing_rad: float
    period_s: float
    phase_rad: float
    steps: int

    def commands(self, step_time: float) -> np.ndarray:
        phases = self.phase_rad + 2 * math.pi * np.arange(self.steps + 1) * step_time / self.period_s
        turn = self.direction * self.swing_rad * np.diff(np.sin(phases)) / step_time
        return np.stack([np.zeros(self.steps), turn], axis=1)

    def start(self, size_m: float, step_time: float) -> list[float]:
        return list(self.pose)


class RandomGoals(Section):
    """Straight drives to random goals, with turns in place; a range of speeds is sampled once per world.

    In a part of the worlds, the robot stands. It keeps `margin_m` from the border of the map [m], at least its radius.
    """

    name: Literal["random_goals"]
    speed_m_s: OneOrRange[Speed]
    turn_rad_s: OneOrRange[Speed]
    steps: WindowSteps
    margin_m: Length | None = None
    standing: Standing | None = None


Motion = Annotated[FullTurn | Square | Waypoints | RandomGoals, Field(discriminator="name")]
Drive = RotationDrive | SquareDrive | WaypointDrive | SweepDrive
DRIVES: dict[str, Any] = {
    "rotate": RotationDrive,
    "square": SquareDrive,
    "waypoints": WaypointDrive,
    "sweep": SweepDrive,
}


def drive_of(behavior: dict[str, Any]) -> Drive:
    """Return the drive of a robot behavior as written in a world YAML.

    Raises:
        InputError: the behavior is none of `DRIVES`.
    """
    if behavior["name"] not in DRIVES:
        raise InputError(f"robot behavior must be one of {sorted(DRIVES)}, got {behavior['name']!r}")
    return DRIVES[behavior["name"]](**{key: value for key, value in behavior.items() if key != "name"})


def _evenly(total: float, rate: float, step_time: float, column: int) -> np.ndarray:
    """Divide a way [m] or a turn [rad] into the least number of equal steps at no more than `rate`, (S, 2)."""
    steps = math.ceil(abs(total) / (rate * step_time) - 1e-9)
    commands = np.zeros((steps, 2))
    commands[:, column] = total / (steps * step_time) if steps else 0.0
    return commands


def integrated(commands: np.ndarray, start: list[float], step_time: float) -> np.ndarray:
    """Integrate commands from a start x, y [m], heading [rad]; return the poses, beginning with it, (T + 1, 3)."""
    speed, turn = commands.T
    heading = start[2] + np.concatenate([[0], np.cumsum(turn * step_time)])
    moves = speed * step_time * np.stack([np.cos(heading[:-1]), np.sin(heading[:-1])])
    position = np.array(start[:2])[:, None] + np.pad(np.cumsum(moves, axis=1), ((0, 0), (1, 0)))
    return np.stack([*position, heading], axis=1)
