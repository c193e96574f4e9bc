"""The planner of all mappers: a cost-to-go on the map, and arcs that are rolled out over it.

The probability of an obstacle p is inflated: the largest one within a radius. A meter costs 1 + weight p. Dijkstra's
algorithm (SciPy) gives the cost from every pixel to the goal. Of the arcs of constant speed and turn over two seconds,
as in the dynamic window approach (Fox, Burgard and Thrun 1997), the robot takes the one with the least sum of the cost
from its end to the goal, of a risk times the weight times the longest way, and, if it drives backward, of the longest
way. The risk is the mean of the inflated p along the arc and `costs.LETHAL` times the largest p within the robot's
radius.
"""

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from repro.maps.grid import Grid
from repro.maps.outlines import placed
from repro.navigation.costs import inflate, roll_out

HORIZON_S = 2.0  # of an arc
LAYER_S = 0.5  # from one map of the future to the next
TIMES_S = np.arange(1, 11) * HORIZON_S / 10  # of the points of an arc at which the map is read
SPEEDS = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the largest
TURNS = 13  # from one largest rate of turn to the other


@dataclass(frozen=True)
class Settings:
    """What is tuned for every mapper.

    Args:
        inflation_m: radius by which obstacles grow [m].
        weight: cost of a meter in an obstacle, in meters.
        threshold: probability above which a pixel is an obstacle; None takes the probabilities as they are.
    """

    inflation_m: float
    weight: float
    threshold: float | None = None


class Planner:
    """Commands for many robots, each with its map.

    Args:
        grid: grid of the maps.
        settings: tuned values.
        radius_m: radius of the robots [m].
        speed_m_s: largest speed [m/s].
        turn_rad_s: largest rate of turn [rad/s].
    """

    def __init__(self, grid: Grid, settings: Settings, radius_m: float, speed_m_s: float, turn_rad_s: float) -> None:
        self.grid, self.settings, self.speed_m_s, self.longest_m = grid, settings, speed_m_s, speed_m_s * HORIZON_S
        speeds, turns = speed_m_s * np.array(SPEEDS), np.linspace(-turn_rad_s, turn_rad_s, TURNS)
        self.commands = np.array([*itertools.product(speeds, turns)])
        self.arcs = arcs(self.commands, TIMES_S)
        reach = int(settings.inflation_m / grid.resolution_m)
        offsets = grid.resolution_m * np.arange(-reach, reach + 1)
        away = np.hypot(offsets[:, None], offsets)
        core = radius_m + grid.resolution_m / 2
        fall = (settings.inflation_m - away) / max(settings.inflation_m - core, 1e-9)  # less than 0 spreads nothing
        self.fall, self.core = np.where(away <= core, 1, fall), np.where(away <= core, 1.0, 0.0)

    def plan(self, occupied: np.ndarray, poses: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """Choose the commands of E robots.

        Args:
            occupied: probability of an obstacle now and every `LAYER_S` later, K maps, (E, K, H, W).
            poses: x, y [m], heading [rad], (E, 3).
            goals: x, y [m], (E, 2).

        Returns:
            speed [m/s] and rate of turn [rad/s], (E, 2).
        """
        return self.commands[self.costs(occupied, poses, goals).argmin(1)]

    def costs(self, occupied: np.ndarray, poses: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """Return the cost of every arc of E robots, (E, A), see `plan`; infinite where it ends off the map."""
        if self.settings.threshold is not None:
            occupied = (occupied > self.settings.threshold).astype(np.float32)
        inflated, lethal = self.inflate(occupied, self.fall), self.inflate(occupied, self.core)
        points = placed(self.arcs, poses[:, None]) / self.grid.resolution_m  # (E, A, P, 2)
        layer = np.minimum(TIMES_S // LAYER_S, occupied.shape[1] - 1).astype(int)
        to_go = np.stack([self.cost_to_go(maps[0], goal) for maps, goal in zip(inflated, goals, strict=True)])
        left, risk = roll_out(to_go, inflated, lethal, points, layer)
        return left + self.settings.weight * self.longest_m * risk + self.longest_m * (self.commands[:, 0] < 0)

    def inflate(self, occupied: np.ndarray, fall: np.ndarray) -> np.ndarray:
        """Return the largest product of p and the weight of its distance around each pixel, (..., H, W)."""
        inflated = np.zeros_like(occupied)
        inflate(occupied.reshape(-1, *occupied.shape[-2:]), fall, inflated.reshape(-1, *occupied.shape[-2:]))
        return inflated

    def cost_to_go(self, inflated: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Compute the cost from every pixel of a map (H, W) to a goal [m], (H, W)."""
        size = self.grid.size_px
        cost = (1 + self.settings.weight * inflated).ravel() * self.grid.resolution_m
        start, end, first, length = _neighbors(size)
        graph = csr_array((0.5 * (cost[start] + cost[end]) * length, end, first), shape=(size**2, size**2))
        column, row = np.clip(goal // self.grid.resolution_m, 0, size - 1).astype(int)
        return dijkstra(graph, indices=(size - 1 - row) * size + column).reshape(size, size)


def arcs(commands: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Compute the points of arcs from the origin, heading along x [m], (A, P, 2).

    Args:
        commands: speed [m/s] and rate of turn [rad/s], (A, 2).
        times: times of the points [s], (P,).
    """
    speed, turn = commands[:, :1], commands[:, 1:]
    angle = turn * times / 2
    chord = speed * times * np.sinc(angle / np.pi)
    return np.stack([chord * np.cos(angle), chord * np.sin(angle)], axis=-1)


@lru_cache(maxsize=4)
def _neighbors(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the edges between the eight neighbors on a grid, sorted: start, end, first edge of each pixel, length."""
    pixel = np.arange(size**2).reshape(size, size)
    starts, ends, lengths = [], [], []
    for down, right in itertools.product((-1, 0, 1), repeat=2):
        if down or right:
            own = pixel[max(0, -down) : size - max(0, down), max(0, -right) : size - max(0, right)].ravel()
            starts.append(own)
            ends.append(own + down * size + right)
            lengths.append(np.full(len(own), np.hypot(down, right)))
    start, end, length = map(np.concatenate, (starts, ends, lengths))
    order = np.lexsort((end, start))
    first = np.searchsorted(start[order], np.arange(size**2 + 1))
    return start[order], end[order].astype(np.int32), first.astype(np.int32), length[order]
