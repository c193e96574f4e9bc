"""Motions of the robot in a file of conf/world."""

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from repro.world_fields import (
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
    """A full turn in place; `turned_rad` [rad] is its start heading, or the range of it."""

    name: Literal["rotate"]
    steps: WindowSteps
    turned_rad: OneOrRange[Angle] = 0.0


class Square(Part):
    """A square, turned about the center of the map by `turned_rad` [rad], or by an angle in that range."""

    name: Literal["square"]
    side_m: Length
    drive_steps: Annotated[int, Field(ge=1, le=100_000)]
    turn_steps: Annotated[int, Field(ge=1, le=100_000)]
    first_steps: Annotated[int, Field(ge=0)]
    turned_rad: OneOrRange[Angle] = 0.0

    @property
    def steps(self) -> int:
        return 4 * (self.drive_steps + self.turn_steps)


class Waypoints(Part):
    """Straight drives along given points, with turns in place."""

    name: Literal["waypoints"]
    points_m: Annotated[list[Point], Field(min_length=2, max_length=1000), AfterValidator(distinct)]
    speed_m_s: Speed
    turn_rad_s: Speed
    steps: WindowSteps


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


Motion = Annotated[Rotation | Square | Waypoints | RandomGoals, Field(discriminator="name")]
