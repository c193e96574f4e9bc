"""Motions of obstacles, by the name of their `behavior`: parameters in conf/world, and the velocity of each step.

Paper: "Simulation Approach". Unstated details: DEVIATIONS D5 and D6.
"""

import math
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field

from repro.worlds.limits import Probability, Range, Section, Speed, Steps

_TURNS = 20  # headings tried at a wall before an obstacle stands still for a step


class ObstacleMotion(Protocol):
    """The interface of a motion: created with the parameters of a behavior, then asked once per step.

    The parameters are those of conf/world, with `speed_m_s` drawn from its range, and those of the world: `seed` of the
    obstacle's random stream, `center_m` (x, y) and radius `keep_out_m` of the zone that it must not enter [m], and,
    where there are walls, `walls_m` and `radius_m`, the lines and the distance that it keeps from them [m].
    """

    def velocity(self, x: float, y: float, step_time: float) -> tuple[float, float]:
        """Compute the velocity of the next step in the world frame [m/s], for an obstacle at (x, y) [m]."""


class Drifting(Section):
    """The parameters of `Drift`."""

    name: Literal["drift"]
    speed_m_s: Range[Speed]
    turn_steps: Range[Steps]


class Drift:
    """Motion in straight lines at constant speed, with turns at random intervals, at the center zone and at walls.

    Paper: obstacles "moved in straight lines at constant speeds, changing directions randomly at specified
    intervals throughout the run, or whenever they entered the center zone occupied by the robot". A turn at
    the zone is uniform over the half plane facing away from the center; any other turn is uniform over the circle.

    The paper's worlds have no walls. Where there are some, an obstacle whose next step would touch one turns to a
    heading in the half plane facing away from it, and stands still for a step where none of 20 headings is free.

    Args:
        seed: seed of this obstacle's own random stream.
        speed_m_s: constant speed [m/s].
        turn_steps: minimum and maximum time steps between two random turns.
        center_m: center of the zone (x, y) [m].
        keep_out_m: least distance between the obstacle's origin and the center [m].
        walls_m: lines of points (x, y) [m] that the obstacle does not touch.
        radius_m: least distance between the obstacle's origin and a wall [m].
    """

    def __init__(
        self,
        *,
        seed: int,
        speed_m_s: float,
        turn_steps: tuple[int, int],
        center_m: tuple[float, float],
        keep_out_m: float,
        walls_m: list[list[list[float]]] | None = None,
        radius_m: float = 0.0,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.speed_m_s = speed_m_s
        self.turn_steps = turn_steps
        self.center_m = center_m
        self.keep_out_m = keep_out_m
        self.walls: Any = _walls(walls_m) if walls_m else None
        self.radius_m = radius_m
        self._steps_clear = 0  # further steps that cannot end at a wall
        self._head(self.rng.uniform(-math.pi, math.pi))
        self._countdown = self._interval()

    def velocity(self, x: float, y: float, step_time: float) -> tuple[float, float]:
        """Compute the velocity of the next step in the world frame [m/s], for an obstacle at (x, y) [m]."""
        if self._countdown == 0:
            self._turn()
            self._countdown = self._interval()
        self._countdown -= 1
        away_x, away_y = x - self.center_m[0], y - self.center_m[1]
        if self._enters_zone(away_x, away_y, step_time):
            self._head(math.atan2(away_y, away_x) + self.rng.uniform(-math.pi / 2, math.pi / 2))
        if self.walls is None or self._is_clear(x, y, step_time):
            return self.vx, self.vy
        wall_x, wall_y = self.walls.nearest(x, y)
        away = math.atan2(y - wall_y, x - wall_x)
        for _ in range(_TURNS):
            self._head(away + self.rng.uniform(-math.pi / 2, math.pi / 2))
            if self._is_clear(x, y, step_time) and not self._enters_zone(away_x, away_y, step_time):
                return self.vx, self.vy
        return 0.0, 0.0

    def _turn(self) -> None:
        """Draw the next heading."""
        self._head(self.rng.uniform(-math.pi, math.pi))

    def _enters_zone(self, away_x: float, away_y: float, step_time: float) -> bool:
        next_m = math.hypot(away_x + self.vx * step_time, away_y + self.vy * step_time)
        return next_m < self.keep_out_m and self.vx * away_x + self.vy * away_y < 0

    def _is_clear(self, x: float, y: float, step_time: float) -> bool:
        """Check that the next step ends clear of the walls."""
        if self._steps_clear > 0:
            self._steps_clear -= 1
            return True
        gap_m = self.walls.distance_m(x + self.vx * step_time, y + self.vy * step_time) - self.radius_m
        self._steps_clear = int(gap_m / (self.speed_m_s * step_time) - 1e-6)  # whatever its headings
        return gap_m >= 0

    def _interval(self) -> int:
        return int(self.rng.integers(self.turn_steps[0], self.turn_steps[1] + 1))

    def _head(self, heading: float) -> None:
        self.vx = self.speed_m_s * math.cos(heading)
        self.vy = self.speed_m_s * math.sin(heading)


class Walking(Section):
    """The parameters of `Walk`."""

    name: Literal["walk"]
    speed_m_s: Range[Speed]
    way_steps: Range[Steps]
    turn_rad: Annotated[float, Field(ge=0, le=math.pi, allow_inf_nan=False)]
    stop_share: Probability
    stop_steps: Range[Steps]


class Walk(Drift):
    """The walk of a person: straight ways, of which each ends with a stop or a turn.

    A person begins with a stop as probable as at the end of a way. Walls and zone are those of `Drift`.

    Args:
        way_steps: least and most time steps of a way.
        turn_rad: standard deviation of a turn [rad].
        stop_share: probability of a stop at the end of a way.
        stop_steps: least and most time steps of a stop.
        others: those of `Drift`.
    """

    def __init__(
        self,
        *,
        way_steps: tuple[int, int],
        turn_rad: float,
        stop_share: float,
        stop_steps: tuple[int, int],
        **others: Any,
    ) -> None:
        super().__init__(turn_steps=way_steps, **others)
        self.turn_rad, self.stop_share, self.stop_steps = turn_rad, stop_share, stop_steps
        self._stops = self._stop()

    def velocity(self, x: float, y: float, step_time: float) -> tuple[float, float]:
        """See `Drift.velocity`; 0 during a stop."""
        if self._stops > 0:
            self._stops -= 1
            return 0.0, 0.0
        return super().velocity(x, y, step_time)

    def _turn(self) -> None:
        self._head(math.atan2(self.vy, self.vx) + self.rng.normal(0, self.turn_rad))
        self._stops = self._stop()

    def _stop(self) -> int:
        """Draw the steps of a stop, 0 for none."""
        is_stop, steps = self.rng.random() < self.stop_share, self.rng.integers(*self.stop_steps, endpoint=True)
        return int(steps) if is_stop else 0


Behavior = Annotated[Drifting | Walking, Field(discriminator="name")]
OBSTACLE_MOTIONS: dict[str, type[ObstacleMotion]] = {"drift": Drift, "walk": Walk}


def _walls(lines_m: list[list[list[float]]]) -> Any:
    from repro.worlds.walls import Walls  # shapely, which reading a world without walls does not need

    return Walls(lines_m)


def obstacle_motion(behavior: dict[str, Any]) -> ObstacleMotion:
    """Create the motion of an obstacle from its behavior as written in a world YAML."""
    return OBSTACLE_MOTIONS[behavior["name"]](**{key: value for key, value in behavior.items() if key != "name"})


def obstacle_states(obstacle: dict[str, Any], steps: int, step_time: float) -> np.ndarray:
    """Compute the state of an obstacle of a world after each step: x, y [m], constant heading [rad], (T, 3)."""
    states = np.empty((steps, 3))
    states[:] = obstacle["state"]
    if "behavior" not in obstacle:
        return states
    motion = obstacle_motion(obstacle["behavior"])
    x, y, _ = obstacle["state"]
    for step in range(steps):
        vx, vy = motion.velocity(x, y, step_time)
        x, y = x + vx * step_time, y + vy * step_time
        states[step, :2] = x, y
    return states
