"""Rooms that differ from world to world: their size, doors and corridors, and what keeps off their walls."""

import numpy as np
import pytest
import shapely
from conftest import ROOT

from repro.simulation.rooms import _Floor, sample_rooms
from repro.simulation.sampling import reverse_direction, sample_world
from repro.worlds.spec import read_world, world_spec

WORLD = read_world(ROOT / "conf" / "world" / "rooms.yaml")
SPEC = world_spec(WORLD, "people")
ROOMS, WIDTH = SPEC.rooms, 25.0
SEEDS = range(20)


def walls_of(seed: int, **changes: object) -> shapely.Geometry:
    """Return all walls of a floor, also those that are not on the map, turned to the axes."""
    walls = sample_rooms(np.random.default_rng(seed), ROOMS.model_copy(update=changes), WIDTH)
    return shapely.union_all([shapely.LineString(wall["shape"]["vertices"]) for wall in walls])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robot_that_fits_the_doors_reaches_every_room(seed):
    """All places of the floor that are 0.3 m from the walls are connected, also those that are not on the map."""
    floor = _Floor(np.random.default_rng(seed), ROOMS)
    floor.divide((0.0, 0.0), (35.0, 35.0))
    walls = shapely.union_all([shapely.LineString(wall.piece(*ends)) for wall in floor.walls for ends in wall.spans()])
    assert shapely.box(0, 0, 35, 35).difference(walls.buffer(0.3)).geom_type == "Polygon"


@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_are_as_large_as_asked(seed):
    """A disc as wide as the shortest side fits into a room; one as wide as twice the longest touches a wall."""
    walls = walls_of(seed, corridor_share=0.0)
    places = np.random.default_rng(seed).uniform(WIDTH * 0.35, WIDTH * 0.65, (500, 2))
    distances = shapely.distance(walls, shapely.points(places))
    assert distances.max() >= ROOMS.side_m[0] / 2 * 0.8
    assert distances.max() <= ROOMS.side_m[1]


def gaps_m(seed: int, **changes: object) -> np.ndarray:
    """Return the distances between the lines of all pairs of parallel walls [m]."""
    walls = sample_rooms(np.random.default_rng(seed), ROOMS.model_copy(update=changes), WIDTH)
    ends = np.array([wall["shape"]["vertices"] for wall in walls])
    along = (ends[:, 1] - ends[:, 0]) / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    between = ends[None, :, 0] - ends[:, None, 0]
    parallel = np.abs(along @ across.T) < 1e-6
    return np.abs((between * across[:, None]).sum(-1))[parallel]


@pytest.mark.parametrize("seed", SEEDS)
def test_corridors_are_as_wide_as_asked_and_optional(seed):
    width = {"corridor_m": [1.7, 1.7]}
    assert np.isclose(gaps_m(seed, corridor_share=1.0, **width), 1.7).any()
    assert not np.isclose(gaps_m(seed, corridor_share=0.0, **width), 1.7).any()


def test_every_world_has_its_own_rooms_and_twins_share_them():
    first, second = (sample_world(SPEC, seed) for seed in (0, 1))
    count = first["custom"]["fixed"]
    assert first["obstacle"][:count] != second["obstacle"][:count]
    assert reverse_direction(first)["obstacle"] == first["obstacle"]
    assert sample_world(SPEC, 0) == first
