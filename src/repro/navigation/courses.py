"""Courses: a world with a start and goals for a robot that drives by its maps, among obstacles that ignore it."""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from repro.simulation.placement import Attempts, Site, sample_obstacles
from repro.simulation.sampling import World, check_spec, experiment_number, sample_fixed
from repro.simulation.shapes import boundaries, union
from repro.simulation.simulator import first_states, move_obstacles, outlines_of_world
from repro.system.errors import InputError
from repro.worlds.spec import WorldSpec

GOALS = 2
TURN_STEPS = 100  # of the turn on the spot with which an episode begins, a window
LIMIT_STEPS = 1200  # for the drive
WAY = (0.4, 0.6)  # from one goal to the next, as shares of the side of the map
_SPLIT = 52  # third number of the seed of a course, so that its world is none of the recordings
_RESTARTS = 100  # attempts to draw a course
_TRIES = 1000  # attempts to find its goals


@dataclass(frozen=True, eq=False)
class Course:
    """A course with O obstacles with at most V vertices over S steps; see `simulator.Recording` for the outlines.

    Args:
        seed: its number.
        start: x, y [m], heading [rad], (3,).
        goals: x, y [m] of the goals in their order, (G, 2).
        outlines: outlines of the obstacles in their own frames [m], (O, V, 2).
        states: x, y [m], heading [rad] of the obstacles before the first step and after each one, (O, S + 1, 3).
    """

    seed: int
    start: np.ndarray
    goals: np.ndarray
    outlines: np.ndarray
    states: np.ndarray

    @property
    def way_m(self) -> float:
        """Length of the straight ways from goal to goal [m]."""
        return float(np.linalg.norm(np.diff([self.start[:2], *self.goals], axis=0), axis=1).sum())


def sample_course(spec: WorldSpec, seed: int) -> tuple[Course, World]:
    """Draw the course of a seed, and its world as IR-SIM reads it.

    The obstacles are those of the experiment, and turn at the border of the map. At the start they keep
    `clear_radius_m` from the goals, and during the robot's first turn from the robot.

    Args:
        spec: the world.
        seed: number of the course.

    Raises:
        InputError: there is no room for the goals and the obstacles, or see `worlds.check_spec`.
    """
    check_spec(spec)
    rng = np.random.default_rng([experiment_number(spec.experiment), seed, _SPLIT])
    attempts = Attempts()
    for _ in range(_RESTARTS):
        fixed = sample_fixed(rng, spec)
        walls = union(fixed)
        places = _places(rng, spec, walls)
        if places is None:
            continue
        path = np.concatenate([np.tile(places[0], (TURN_STEPS + 1, 1)), places[1:]])
        width, height = spec.world.width, spec.world.height
        border = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height], [0.0, 0.0]]
        lines = [*boundaries(fixed), border]
        site = Site(np.array([width, height]), spec.clear_radius_m, path, walls, lines, spec.world.step_time)
        obstacles = sample_obstacles(rng, spec.populations, site, attempts)
        if obstacles is not None:
            break
    else:
        raise InputError(
            f"no course in the worlds of {spec.experiment}: expected room for {GOALS} goals, at least {WAY[0]:g} of "
            "the side of the map apart, and for all obstacles"
        )
    start = [*map(float, places[0]), float(rng.uniform(-math.pi, math.pi))]
    robot = {**spec.robot.irsim(), "state": start, "goal": [*map(float, places[-1]), 0.0]}
    world = {"world": spec.world.irsim(), "robot": robot, "obstacle": [*fixed, *obstacles]}
    states = np.hstack([first_states(world)[:, None], move_obstacles(world, TURN_STEPS + LIMIT_STEPS)])
    return Course(seed, np.array(start), places[1:], outlines_of_world(world), states), world


def _places(rng: np.random.Generator, spec: WorldSpec, walls: shapely.Geometry | None) -> np.ndarray | None:
    """Draw the start and the goals, (1 + G, 2), each at least a robot's diameter from walls; None if none is found."""
    side, radius_m = spec.world.width, spec.robot.shape.radius
    margin = max(2 * radius_m, spec.clear_radius_m)
    places = [rng.uniform(margin, side - margin, 2)]
    for _ in range(_TRIES):
        place = rng.uniform(margin, side - margin, 2)
        way = place - places[-1]
        is_far = WAY[0] * side <= np.hypot(*way) <= WAY[1] * side
        is_clear = walls is None or shapely.distance(walls, shapely.points([places[-1], place])).min() >= margin
        is_back = len(places) == 1 or (places[-1] - places[-2]) @ way <= 0  # a turn of 90 degrees or more
        if is_far and is_clear and is_back:
            places.append(place)
        if len(places) == 1 + GOALS:
            return np.array(places)
    return None
