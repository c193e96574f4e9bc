"""Families of worlds like the paper's, which differ in number, shape, place and motion of the obstacles."""

import copy
import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from irsim.lib.algorithm.generation import generate_polygon
from irsim.util.random import set_seed

from repro.reporting.paper import WORLDS
from repro.worlds.spec import read_world

STATIC, MOVING = ("1", "2"), ("3", "4")
NUMBER = 10  # static obstacles in paper.yaml, on average; moving ones are 0.85 times as many
SHAPES = {"discs": 1.0, "rectangles": 0.0}  # share of discs
POLYGONS = 40  # different ones


@dataclass(frozen=True)
class Family:
    """How worlds differ from paper.yaml.

    Args:
        number: static obstacles on average; their area is that of 10 in paper.yaml.
        shape: mixed, discs, rectangles, or polygons as IR-SIM draws them at random.
        clear_m: clear radius of experiments 1 and 3 [m]; that of 2 and 4 is 8.5 m, outside the robot's way.
        speed_m_s: range of speeds of moving obstacles [m/s].
        turn_steps: range of steps between their turns.
        growth: factor of the radius of moving obstacles, for the coverage of paper.yaml at the last step.
    """

    number: int = NUMBER
    shape: str = "mixed"
    clear_m: float = 4.0
    speed_m_s: tuple[float, float] = (0.2, 0.7)
    turn_steps: tuple[int, int] = (50, 100)
    growth: float = 1.0


FAMILIES = {
    "paper": Family(),
    "25": Family(25, clear_m=8.5, growth=1.015),
    "faster": Family(speed_m_s=(0.3, 1.0), growth=1.02),
    "little-faster": Family(speed_m_s=(0.25, 0.8), growth=1.007),
    "polygons": Family(shape="polygons"),
    "turns": Family(turn_steps=(20, 60)),
    "straight": Family(turn_steps=(100, 200)),
    "little-faster-straight": Family(speed_m_s=(0.25, 0.8), turn_steps=(100, 200), growth=1.01),
    "discs": Family(shape="discs"),
    "rectangles": Family(shape="rectangles"),
    "20": Family(20, clear_m=8.5, growth=1.015),
    "15": Family(15, growth=1.015),
    "30": Family(30, clear_m=8.5, growth=1.02),
    "clear": Family(clear_m=8.5),
    "polygons-little-faster": Family(shape="polygons", speed_m_s=(0.25, 0.8), growth=1.007),
}


def source(name: str, experiment: str) -> str:
    """Return the first family with the same worlds in an experiment; its recordings and trainings serve all others."""
    own = world_of(FAMILIES[name])["experiments"][experiment]
    return next(other for other in FAMILIES if world_of(FAMILIES[other])["experiments"][experiment] == own)


@functools.cache
def world_of(family: Family) -> dict[str, Any]:
    """Return the content of a file of conf/world for a family."""
    world = copy.deepcopy(read_world(WORLDS))
    shrink = math.sqrt(NUMBER / family.number)
    for experiment in STATIC + MOVING:
        own = world["experiments"][experiment]
        population, factor = own["obstacles"], shrink * (family.growth if experiment in MOVING else 1)
        population["count"] = [round(count * family.number / NUMBER) for count in population["count"]]
        population["radius_m"] = [factor * radius for radius in population["radius_m"]]
        population["disc_share"] = SHAPES.get(family.shape, population["disc_share"])
        if experiment in MOVING:
            population["behavior"] |= {"speed_m_s": [*family.speed_m_s], "turn_steps": [*family.turn_steps]}
        if family.shape == "polygons":
            own["obstacles"] = _as_polygons(population)
        if experiment in ("1", "3"):
            own["clear_radius_m"] = family.clear_m
    return world


def _as_polygons(population: dict[str, Any]) -> dict[str, Any]:
    """Return a population of polygons, with the areas that its discs would have.

    IR-SIM draws corners, irregularity and spikeyness from these ranges where a world file has `random_shape: true`.
    """
    set_seed(0)  # of what IR-SIM draws
    rng, shapes, (low, high) = np.random.default_rng(0), [], population["radius_m"]
    for radius in np.linspace(low, high, POLYGONS):
        while True:
            corners, irregularity, spikeyness = int(rng.integers(4, 10)), *rng.uniform(0, 1, 2)
            vertices = np.array(generate_polygon(np.zeros(2), 1.0, irregularity, spikeyness, corners))
            vertices = vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]  # no corner twice
            outline = shapely.Polygon(vertices)
            if outline.is_valid and outline.area > 0.5:  # slivers would be many meters long
                break
        vertices *= radius * math.sqrt(math.pi / outline.area)
        shapes.append({"name": "polygon", "vertices": vertices.round(3).tolist()})
    moves = {"behavior": population["behavior"]} if "behavior" in population else {}
    return {"count": population["count"], "shapes": shapes, **moves}
