"""Motions of the moving obstacles, by the name of their `behavior` in a world."""

from typing import Any, Protocol

import numpy as np

from repro.simulation.drift import Drift, Walk


class ObstacleMotion(Protocol):
    """The interface of a motion: created with the parameters of a behavior, then asked once per step.

    The parameters are those of conf/world, with `speed_m_s` drawn from its range, and those of the world: `seed` of the
    obstacle's random stream, `center_m` (x, y) and radius `keep_out_m` of the zone that it must not enter [m], and,
    where there are walls, `walls_m` and `radius_m`, the lines and the distance that it keeps from them [m].
    """

    def velocity(self, x: float, y: float, step_time: float) -> tuple[float, float]:
        """Compute the velocity of the next step in the world frame [m/s], for an obstacle at (x, y) [m]."""


OBSTACLE_MOTIONS: dict[str, type[ObstacleMotion]] = {
    "drift": Drift,
    "walk": Walk,
}


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
