"""People walk to goals, keep off walls, and see the robot when they are said to."""

import numpy as np
import pytest
import shapely
from conftest import ROOT

from repro.maps.grid import Grid
from repro.navigation.arms import CLASSICAL
from repro.navigation.courses import TURN_STEPS, sample_course
from repro.navigation.crowds import Crowd
from repro.navigation.episodes import Fleet
from repro.simulation.shapes import standing, union
from repro.worlds.spec import read_world, world_spec

WORLD = read_world(ROOT / "conf" / "world" / "rooms.yaml")
SPECS = {name: world_spec(WORLD, name) for name in ("crossing", "people")}
WALL = standing({"name": "rectangle", "length": 0.4, "width": 14.0}, (10.0, 7.0, 0.0))  # a door of 6 m beyond it


def crowd(places, walls=(), speed_m_s=1.0) -> Crowd:
    places = np.array(places, dtype=float)
    count = len(places)
    return Crowd(places, np.full(count, 0.3), np.full(count, speed_m_s), walls, np.array([20.0, 20.0]), 0.1, seed=1)


def walked(people: Crowd, steps: int, robot=None) -> np.ndarray:
    return np.array([people.step(robot).copy() for _ in range(steps)])  # (T, N, 2)


def test_people_walk_stop_and_go_on():
    places = walked(crowd([[5.0, 5.0], [15.0, 15.0]]), 1200)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=-1) / 0.1
    assert speeds.max() <= 1.3 + 1e-9
    assert 0.7 < np.median(speeds) < 1.1, "about the speed that they like"
    assert (speeds < 0.05).mean() > 0.02, "stops"
    assert np.ptp(places, axis=0).min() > 5, "through the whole place"


def test_people_do_not_walk_through_walls():
    people = crowd([[5.0, 5.0], [15.0, 5.0], [5.0, 15.0]], [WALL])
    inside = union([WALL])
    distances = shapely.distance(inside, shapely.points(walked(people, 1500)))
    assert distances.min() > 0.1


def test_people_keep_apart_and_avoid_a_robot_that_they_see():
    apart, robot = [], np.array([10.0, 10.0, 0.0, 0.0, 0.3])
    for seen in (None, robot):
        people = crowd([[3.0, 10.0]])
        people.goals[:], people.rests[:], people.until_s[:] = [17.0, 10.0], False, 100.0
        apart.append(np.linalg.norm(walked(people, 120, seen)[:, 0] - robot[:2], axis=1).min())
    assert apart[0] < 0.1
    assert apart[1] > 0.6


def test_courses_with_people_are_the_same_for_all_maps_unless_people_see_the_robot():
    course, world = sample_course(SPECS["crossing"], 3, has_people=True)
    assert course.people == sum("behavior" in each for each in world["obstacle"]) >= 8
    settings = {"inflation_m": 0.8, "weight": 20.0, "threshold": None}
    tracks = {}
    for arm in ("truth", "scan"):
        for is_visible in (False, True):
            fleet = Fleet(SPECS["crossing"], [course], CLASSICAL[arm], settings, Grid(64, 25.0), is_visible=is_visible)
            fleet.drive()
            steps = min(TURN_STEPS + 40, TURN_STEPS + round(fleet.episodes[0].time_s / 0.1))
            tracks[arm, is_visible] = fleet.obstacles[:, 0, : steps + 1]
    known = min(len(track[0]) for track in tracks.values())
    assert known > TURN_STEPS + 10
    assert np.array_equal(tracks["truth", False][:, :known], tracks["scan", False][:, :known])
    assert np.array_equal(tracks["truth", False][:, : TURN_STEPS + 1], tracks["truth", True][:, : TURN_STEPS + 1])
    assert not np.array_equal(tracks["truth", False][:, :known], tracks["truth", True][:, :known])


@pytest.mark.parametrize("name", SPECS)
def test_people_begin_where_their_world_has_them_and_leave_the_turning_robot_alone(name):
    course, world = sample_course(SPECS[name], 0, has_people=True)
    first = np.array([each["state"][:2] for each in world["obstacle"]])
    assert np.array_equal(course.states[:, 0, :2], first)
    people = course.crowd()
    robot = np.array([*course.start[:2], 0.0, 0.0, 0.3])
    for _ in range(TURN_STEPS):
        assert (np.linalg.norm(people.step(robot) - course.start[:2], axis=1) > 0.3 + people.radii).all()
