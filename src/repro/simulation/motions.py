"""How things move: the robot's rotation and square, the obstacles' drift. Plain arithmetic, without IR-SIM.

Paper: "Simulation Approach". What it leaves open: DEVIATIONS D2 to D6.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np


def rotate_commands(*, steps: int, direction: int, step_time: float) -> np.ndarray:
    """Computes the commands of one full turn in place.

    Args:
        steps: time steps the turn takes, T.
        direction: 1 for counter-clockwise, -1 for clockwise.
        step_time: duration of a step [s].

    Returns:
        linear and angular velocity of each step [m/s, rad/s], (T, 2).
    """
    return np.tile([0.0, direction * 2 * math.pi / (steps * step_time)], (steps, 1))


def square_commands(
    *, side_m: float, drive_steps: int, turn_steps: int, first_steps: int, direction: int, step_time: float
) -> np.ndarray:
    """Computes the commands of one square: along a side to the corner, a quarter turn on the spot, four times over.

    Args:
        side_m: side of the square [m].
        drive_steps: time steps along a side.
        turn_steps: time steps at a corner.
        first_steps: time steps from the start to the first corner; half of drive_steps is the middle of a side.
        direction: 1 for counter-clockwise (turning left), -1 for clockwise.
        step_time: duration of a step [s].

    Returns:
        linear and angular velocity of each step [m/s, rad/s], (T, 2) with T = 4 (drive_steps + turn_steps).

    Raises:
        ValueError: first_steps is longer than a side.
    """
    if not 0 <= first_steps <= drive_steps:
        raise ValueError(f"first_steps must be between 0 and drive_steps={drive_steps}, got {first_steps}")
    drive = np.tile([side_m / (drive_steps * step_time), 0.0], (drive_steps, 1))
    turn = np.tile([0.0, direction * math.pi / 2 / (turn_steps * step_time)], (turn_steps, 1))
    return np.tile(np.concatenate([drive[:first_steps], turn, drive[first_steps:]]), (4, 1))


def robot_commands(behavior: dict[str, Any], step_time: float) -> np.ndarray:
    """Computes the commands of a robot behaviour as a world YAML names it.

    Raises:
        ValueError: the behaviour is not one of ours.
    """
    parameters = {key: value for key, value in behavior.items() if key != "name"}
    makers: dict[str, Callable[..., np.ndarray]] = {"rotate": rotate_commands, "square": square_commands}
    if behavior["name"] not in makers:
        raise ValueError(f"robot behaviour must be one of {sorted(makers)}, got {behavior['name']!r}")
    return makers[behavior["name"]](**parameters, step_time=step_time)


def robot_path(behavior: dict[str, Any], start: list[float], step_time: float) -> np.ndarray:
    """Integrates the commands of a robot behaviour.

    Args:
        behavior: as a world YAML names it.
        start: x, y [m], heading [rad].
        step_time: duration of a step [s].

    Returns:
        poses from the start on: x, y [m], heading [rad], (T + 1, 3).
    """
    speed, turn = robot_commands(behavior, step_time).T
    heading = start[2] + np.concatenate([[0], np.cumsum(turn * step_time)])
    moves = speed * step_time * np.stack([np.cos(heading[:-1]), np.sin(heading[:-1])])
    position = np.array(start[:2])[:, None] + np.pad(np.cumsum(moves, axis=1), ((0, 0), (1, 0)))
    return np.stack([*position, heading], axis=1)


class Drift:
    """A straight line at constant speed, turned at random intervals and at the centre zone.

    Paper: obstacles "moved in straight lines at constant speeds, changing directions randomly at specified
    intervals throughout the run, or whenever they entered the center zone occupied by the robot". A turn at
    the zone is uniform over the half plane that leads away from the centre; any other is uniform over the circle.

    Args:
        seed: seed of this obstacle's own random stream.
        speed_m_s: constant speed [m/s].
        turn_steps: fewest and most time steps between two random turns.
        centre_m: centre of the zone (x, y) [m].
        keep_out_m: distance that the obstacle's own origin keeps from the centre [m].
    """

    def __init__(
        self,
        *,
        seed: int,
        speed_m_s: float,
        turn_steps: tuple[int, int],
        centre_m: tuple[float, float],
        keep_out_m: float,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.speed_m_s = speed_m_s
        self.turn_steps = turn_steps
        self.centre_m = centre_m
        self.keep_out_m = keep_out_m
        self._head(self.rng.uniform(-math.pi, math.pi))
        self._countdown = self._interval()

    def velocity(self, x: float, y: float, step_time: float) -> tuple[float, float]:
        """Computes the velocity of the coming step in the world frame [m/s], for an obstacle at (x, y) [m]."""
        if self._countdown == 0:
            self._head(self.rng.uniform(-math.pi, math.pi))
            self._countdown = self._interval()
        self._countdown -= 1
        away_x, away_y = x - self.centre_m[0], y - self.centre_m[1]
        next_m = math.hypot(away_x + self.vx * step_time, away_y + self.vy * step_time)
        if next_m < self.keep_out_m and self.vx * away_x + self.vy * away_y < 0:
            self._head(math.atan2(away_y, away_x) + self.rng.uniform(-math.pi / 2, math.pi / 2))
        return self.vx, self.vy

    def _interval(self) -> int:
        return int(self.rng.integers(self.turn_steps[0], self.turn_steps[1] + 1))

    def _head(self, heading: float) -> None:
        self.vx = self.speed_m_s * math.cos(heading)
        self.vy = self.speed_m_s * math.sin(heading)
