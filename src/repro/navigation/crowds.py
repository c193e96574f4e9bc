"""People who walk from goal to goal by the social force model of IR-SIM."""

import itertools
from collections.abc import Sequence

import numpy as np
import shapely
from irsim.lib.algorithm.social_force_model import SocialForceModelBatch

from repro.simulation.shapes import Obstacle, boundaries, union

HASTE = 1.3  # largest speed, as a share of the one that a person likes
WALL_M = 0.2  # decay length of the force of walls, as in pedsim_ros, so that doors can be passed
SAFETY_M = 0.5  # personal space, half of the distance within which the force no longer grows
REACHED_M = 0.5  # distance at which a goal counts as reached
PATIENCE_S = 20.0  # after which a person gives a goal up
STOP_SHARE, STOP_S = 0.3, (1.0, 5.0)  # share of the goals at which a person stops, and for how long
_TRIES = 20  # to find a goal on a straight way that is clear of walls


class Crowd:
    """N people.

    The forces are those of Moussaid et al. (Proc. R. Soc. B 276, 2009), toward the goal and away from people, and of
    Helbing and Molnar (Phys. Rev. E 51, 1995), away from walls. Goals are uniform on the map, where the straight way
    is clear of walls.

    Args:
        places: x, y of the people [m], (N, 2).
        radii: their radii [m], (N,).
        speeds: the speeds that they like [m/s], (N,).
        standing: the obstacles that stand.
        size_m: width and height of the map [m], (2,).
        step_s: duration of a step [s].
        seed: of the random numbers of the goals.
    """

    def __init__(
        self,
        places: np.ndarray,
        radii: np.ndarray,
        speeds: np.ndarray,
        standing: Sequence[Obstacle],
        size_m: np.ndarray,
        step_s: float,
        seed: int,
    ) -> None:
        self.places, self.radii, self.speeds, self.walls = places.copy(), radii, speeds, union(standing)
        self.size_m, self.step_s, self.rng = size_m, step_s, np.random.default_rng(seed)
        self.velocities, self.time_s = np.zeros_like(places), 0.0
        self.goals, self.until_s = places.copy(), np.zeros(len(places))
        self.rests = np.ones(len(places), dtype=bool)
        self.lines = [[*a, *b] for line in boundaries(standing) for a, b in itertools.pairwise(line)]
        self.model = SocialForceModelBatch(
            np.zeros((len(places), 8)),
            vmax=HASTE * speeds.max(initial=0.0),
            step_time=step_s,
            sigma_obstacle=WALL_M,
            safety_radius=SAFETY_M,
        )

    def step(self, robot: np.ndarray | None = None) -> np.ndarray:
        """Walk for a step.

        Args:
            robot: x, y [m], velocity [m/s] and radius [m] of a robot that they see, (5,).

        Returns:
            x, y of the people [m], (N, 2).
        """
        away = np.linalg.norm(self.goals - self.places, axis=1)
        for person in np.flatnonzero((self.until_s <= self.time_s) | (~self.rests & (away < REACHED_M))):
            self._decide(int(person))
        ahead = self.goals - self.places
        wanted = self.speeds[:, None] * ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
        wanted[self.rests] = 0
        states = np.column_stack([self.places, self.velocities, self.radii, wanted, np.zeros(len(self.places))])
        self.model.update(states, None if robot is None else [robot], self.lines)
        self.velocities = self.model.cal_vel()
        self.places = np.clip(self.places + self.step_s * self.velocities, 0, self.size_m)
        self.time_s += self.step_s
        return self.places

    def _decide(self, person: int) -> None:
        """Stop for a while at a goal, or choose the next one."""
        if not self.rests[person] and self.rng.random() < STOP_SHARE:
            self.rests[person], self.until_s[person] = True, self.time_s + self.rng.uniform(*STOP_S)
            return
        margin = self.radii[person] + WALL_M
        for goal in self.rng.uniform(margin, self.size_m - margin, (_TRIES, 2)):
            way = shapely.LineString([self.places[person], goal])
            if self.walls is None or shapely.distance(self.walls, way) >= margin:
                self.goals[person], self.rests[person] = goal, False
                self.until_s[person] = self.time_s + PATIENCE_S
                return
        self.rests[person], self.until_s[person] = True, self.time_s + STOP_S[0]
