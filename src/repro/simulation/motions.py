"""Motions of the robot (rotation, square) and of the obstacles (drift), independent of IR-SIM.

Paper: "Simulation Approach". Unstated details: DEVIATIONS D2 to D6.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np


def rotate_commands(*, steps: int, direction: int, step_time: float) -> np.ndarray:
    """Compute the commands of one full turn in place.

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
    """Compute the commands of one square: along a side to the corner, a quarter turn in place, four times.

    Args:
        side_m: side of the square [m].
        drive_steps: time steps along a side.
        turn_steps: time steps at a corner.
        first_steps: time steps from the start to the first corner; drive_steps / 2 starts in the middle of a side.
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
    """Compute the commands of a robot behavior as written in a world YAML.

    Args:
        behavior: `rotate` or `square` with its parameters.
        step_time: duration of a step [s].

    Returns:
        linear and angular velocity of each step [m/s, rad/s], (T, 2).

    Raises:
        ValueError: the behavior is neither `rotate` nor `square`.
    """
    parameters = {key: value for key, value in behavior.items() if key != "name"}
    makers: dict[str, Callable[..., np.ndarray]] = {"rotate": rotate_commands, "square": square_commands}
    if behavior["name"] not in makers:
        raise ValueError(f"robot behavior must be one of {sorted(makers)}, got {behavior['name']!r}")
    return makers[behavior["name"]](**parameters, step_time=step_time)


def robot_path(behavior: dict[str, Any], start: list[float], step_time: float) -> np.ndarray:
    """Integrate the commands of a robot behavior.

    Args:
        behavior: as written in a world YAML.
        start: x, y [m], heading [rad].
        step_time: duration of a step [s].

    Returns:
        poses, beginning with the start: x, y [m], heading [rad], (T + 1, 3).
    """
    speed, turn = robot_commands(behavior, step_time).T
    heading = start[2] + np.concatenate([[0], np.cumsum(turn * step_time)])
    moves = speed * step_time * np.stack([np.cos(heading[:-1]), np.sin(heading[:-1])])
    position = np.array(start[:2])[:, None] + np.pad(np.cumsum(moves, axis=1), ((0, 0), (1, 0)))
    return np.stack([*position, heading], axis=1)


class Drift:
    """Motion in straight lines at constant speed, with turns at random intervals and at the center zone.

    Paper: obstacles "moved in straight lines at constant speeds, changing directions randomly at specified
    intervals throughout the run, or whenever they entered the center zone occupied by the robot". A turn at
    the zone is uniform over the half plane facing away from the center; any other turn is uniform over the circle.

    Args:
        seed: seed of this obstacle's own random stream.
        speed_m_s: constant speed [m/s].
        turn_steps: minimum and maximum time steps between two random turns.
        centre_m: center of the zone (x, y) [m].
        keep_out_m: least distance between the obstacle's origin and the center [m].
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
        """Compute the velocity of the next step in the world frame [m/s], for an obstacle at (x, y) [m]."""
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
