"""Motions of the robot (rotation, square, waypoints, sweep), independent of IR-SIM.

Paper: "Simulation Approach". Unstated details: DEVIATIONS D2 and D3.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from repro.system.errors import InputError
from repro.world_motions import Motion, RandomGoals, Waypoints


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
        raise InputError(f"first_steps must be between 0 and drive_steps={drive_steps}, got {first_steps}")
    drive = np.tile([side_m / (drive_steps * step_time), 0.0], (drive_steps, 1))
    turn = np.tile([0.0, direction * math.pi / 2 / (turn_steps * step_time)], (turn_steps, 1))
    return np.tile(np.concatenate([drive[:first_steps], turn, drive[first_steps:]]), (4, 1))


def waypoint_commands(
    *,
    points_m: list[list[float]],
    speed_m_s: float,
    turn_rad_s: float,
    steps: int,
    direction: int,
    step_time: float,
) -> np.ndarray:
    """Compute the commands of a drive along waypoints: a turn in place toward the next one, then straight ahead.

    The robot starts at the first waypoint, heading for the second. Each turn and each way takes the least number of
    equal steps within the given speeds. A drive that is longer than `steps` ends on the way; after a shorter one the
    robot stands still.

    Args:
        points_m: waypoints x, y [m].
        speed_m_s: largest speed [m/s].
        turn_rad_s: largest rate of turn [rad/s].
        steps: time steps, T.
        direction: 1 from the first waypoint, -1 from the end of the drive back to it.
        step_time: duration of a step [s].

    Returns:
        linear and angular velocity of each step [m/s, rad/s], (T, 2).
    """
    parts: list[np.ndarray] = []
    heading, length = None, 0
    for (x0, y0), (x1, y1) in itertools.pairwise(points_m):
        if length >= steps:
            break
        ahead, way_m = math.atan2(y1 - y0, x1 - x0), math.hypot(x1 - x0, y1 - y0)
        turn = 0.0 if heading is None else math.remainder(ahead - heading, 2 * math.pi)
        heading = ahead
        parts += [_evenly(turn, turn_rad_s, step_time, column=1), _evenly(way_m, speed_m_s, step_time, column=0)]
        length += len(parts[-2]) + len(parts[-1])
    commands = np.concatenate([*parts, np.zeros((steps, 2))])[:steps]
    return commands if direction == 1 else commands[::-1] * [1, -1]


def sweep_commands(
    *, swing_rad: float, period_s: float, phase_rad: float, steps: int, direction: int, step_time: float
) -> np.ndarray:
    """Compute the commands of a robot that stands and swings its view about a heading, as a sine.

    Args:
        swing_rad: amplitude [rad]; 0 is at rest.
        period_s: duration of a swing to both sides [s].
        phase_rad: phase of the sine at the start [rad].
        steps: time steps, T.
        direction: 1, or -1 for the mirrored swing.
        step_time: duration of a step [s].

    Returns:
        linear and angular velocity of each step [m/s, rad/s], (T, 2).
    """
    phases = phase_rad + 2 * math.pi * np.arange(steps + 1) * step_time / period_s
    turn = direction * swing_rad * np.diff(np.sin(phases)) / step_time
    return np.stack([np.zeros(steps), turn], axis=1)


def _evenly(amount: float, rate: float, step_time: float, column: int) -> np.ndarray:
    """Divide a way [m] or a turn [rad] into the least number of equal steps at no more than `rate`, (S, 2)."""
    steps = math.ceil(abs(amount) / (rate * step_time) - 1e-9)
    commands = np.zeros((steps, 2))
    if steps:
        commands[:, column] = amount / (steps * step_time)
    return commands


ROBOT_MOTIONS: dict[str, Callable[..., np.ndarray]] = {
    "rotate": rotate_commands,
    "square": square_commands,
    "waypoints": waypoint_commands,
    "sweep": sweep_commands,
}


def recorded_steps(behavior: dict[str, Any]) -> int:
    """Return the number of time steps of a recording of a world with this robot behavior, T."""
    return len(robot_commands(behavior, step_time=1.0))


def top_speeds(motion: Motion, step_time: float) -> np.ndarray:
    """Return the largest linear and angular speed of a motion [m/s, rad/s], (2,).

    Raises:
        ValueError: see `robot_commands`.
    """
    if isinstance(motion, Waypoints | RandomGoals):
        swing_rad_s = motion.standing.turn_rad_s if isinstance(motion, RandomGoals) and motion.standing else 0.0
        return np.array([np.max(motion.speed_m_s), max(np.max(motion.turn_rad_s), swing_rad_s)])
    return np.abs(robot_commands({**motion.irsim(), "direction": 1}, step_time)).max(axis=0)


def robot_commands(behavior: dict[str, Any], step_time: float) -> np.ndarray:
    """Compute the commands of a robot behavior as written in a world YAML.

    Args:
        behavior: `rotate`, `square`, `waypoints` or `sweep` with its parameters.
        step_time: duration of a step [s].

    Returns:
        linear and angular velocity of each step [m/s, rad/s], (T, 2).

    Raises:
        ValueError: the behavior is none of these.
    """
    parameters = {key: value for key, value in behavior.items() if key not in ("name", "turned_rad", "pose")}
    if behavior["name"] not in ROBOT_MOTIONS:
        raise InputError(f"robot behavior must be one of {sorted(ROBOT_MOTIONS)}, got {behavior['name']!r}")
    return ROBOT_MOTIONS[behavior["name"]](**parameters, step_time=step_time)


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
