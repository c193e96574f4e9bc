"""Placement of the sampled obstacles: apart, on the map, off the fixed obstacles and out of the robot's way."""

import math
from dataclasses import dataclass
from itertools import islice

import numpy as np
import shapely

from repro.simulation.shapes import Line, Obstacle, Shape, boundaries, shape_radius, standing
from repro.worlds.obstacle_motions import obstacle_states
from repro.worlds.obstacles import Shaped, Sized

_PLACEMENTS = 200  # attempts to place one obstacle
_MOTIONS = 50  # attempts to find it a motion out of the robot's way

Placed = tuple[float, float, Shape, Sized | Shaped]


class Attempts:
    """What is left of the attempts for one world, over all restarts, so that a full map is refused within seconds."""

    def __init__(self) -> None:
        self.places = iter(range(20_000))
        self.motions = iter(range(300))  # each is simulated; worlds of conf/world need 27 at most


@dataclass(frozen=True)
class Site:
    """Where obstacles may stand.

    Args:
        size_m: width and height of the map [m], (2,).
        clear_m: radius of the zone without obstacles, at the center or around a driving robot [m].
        path: positions of a driving robot, from its start to its end, (T + 1, 2); None if it stays in the zone.
        walls: fixed obstacles.
        lines: their outlines.
        step_time: duration of a step [s].
    """

    size_m: np.ndarray
    clear_m: float
    path: np.ndarray | None
    walls: shapely.Geometry | None
    lines: list[Line]
    step_time: float

    def has_room(self, x: float, y: float, radius: float) -> bool:
        """Check a place for the circle around an obstacle: off the walls, and off the zone or the whole path."""
        if self.path is None:
            center = self.size_m / 2
            is_clear = math.hypot(x - center[0], y - center[1]) >= self.clear_m + radius
        else:
            is_clear = np.hypot(*(self.path - [x, y]).T).min() >= self.clear_m + radius
        return is_clear and (self.walls is None or shapely.distance(self.walls, shapely.Point(x, y)) >= radius)

    def keeps_clear(self, obstacle: Obstacle) -> bool:
        """Check that an obstacle stays out of the zone of a driving robot and of its twin at every step."""
        if self.path is None:
            return True
        robots = np.stack([self.path[1:], self.path[-2::-1]])  # the twin drives back from the end, (2, T, 2)
        states = obstacle_states(obstacle, len(self.path) - 1, self.step_time)
        distance = np.linalg.norm(robots - states[:, :2], axis=-1)
        return bool(distance.min() >= self.clear_m + shape_radius(obstacle["shape"]))


def sample_obstacles(
    rng: np.random.Generator, populations: list[Sized | Shaped], site: Site, attempts: Attempts
) -> list[Obstacle] | None:
    """Sample all obstacles of a world as IR-SIM reads them; None if one finds no place or no motion."""
    placed: list[Placed] = []
    for population in populations:
        for _ in range(rng.integers(population.count[0], population.count[1] + 1)):
            found = _place(rng, population, placed, site, attempts)
            if found is None:
                return None
            placed.append(found)
    still_ones = [
        None if population.behavior else standing(shape, (x, y, float(rng.uniform(-math.pi, math.pi))))
        for x, y, shape, population in placed
    ]
    lines = [*site.lines, *boundaries(still for still in still_ones if still)]
    obstacles = []
    for found, still in zip(placed, still_ones, strict=True):
        obstacle = still or _moving(rng, found, site, lines, attempts)
        if obstacle is None:
            return None
        obstacles.append(obstacle)
    return obstacles


def _place(
    rng: np.random.Generator, population: Sized | Shaped, placed: list[Placed], site: Site, attempts: Attempts
) -> Placed | None:
    """Draw a shape and a place for it without overlap, inside the map and outside the zone; None without a place."""
    shape = _shape(rng, population)
    radius = shape_radius(shape)
    if (2 * radius > site.size_m).any():
        return None
    for _ in islice(attempts.places, _PLACEMENTS):
        x, y = rng.uniform(radius, site.size_m - radius)
        apart = all(math.hypot(x - u, y - v) >= radius + shape_radius(other) for u, v, other, _ in placed)
        if apart and site.has_room(x, y, radius):
            return float(x), float(y), shape, population
    return None


def _shape(rng: np.random.Generator, population: Sized | Shaped) -> Shape:
    """Draw one of the shapes of a population, or a disc of random radius or a rectangle of the same area."""
    if isinstance(population, Shaped):
        return population.shapes[rng.integers(len(population.shapes))].irsim()
    radius = rng.uniform(*population.radius_m)
    is_disc, aspect = rng.random() < population.disc_share, rng.uniform(*population.aspect)
    if is_disc:
        return {"name": "circle", "radius": float(radius)}
    width = math.sqrt(math.pi * radius**2 / aspect)
    return {"name": "rectangle", "length": float(aspect * width), "width": float(width)}


def _moving(
    rng: np.random.Generator, placed: Placed, site: Site, lines: list[Line], attempts: Attempts
) -> Obstacle | None:
    """Create an obstacle with a random stream of its own that keeps out of the robot's way; None if none does."""
    x, y, shape, population = placed
    assert population.behavior
    for _ in islice(attempts.motions, _MOTIONS):
        heading = float(rng.uniform(-math.pi, math.pi))
        speed = float(rng.uniform(*population.behavior.speed_m_s))
        limit, radius = 1.01 * speed, shape_radius(shape)
        motion = {
            **population.behavior.irsim(),
            "seed": int(rng.integers(2**31)),
            "speed_m_s": speed,
            "center_m": (site.size_m / 2).tolist(),
            "keep_out_m": float(site.clear_m + radius) if site.path is None else 0.0,
        }
        obstacle = {
            "shape": shape,
            "state": [x, y, heading],
            "kinematics": {"name": "omni"},
            "vel_min": [-limit, -limit],
            "vel_max": [limit, limit],
            "behavior": {**motion, "walls_m": lines, "radius_m": radius} if lines else motion,
        }
        if site.keeps_clear(obstacle):
            return obstacle
    return None
