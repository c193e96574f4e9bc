"""IR-SIM's planners on predicted maps: paths avoid what is predicted, and nothing else."""

import itertools

import numpy as np
import pytest
from irsim.lib.path_planners.jps import JPSPlanner
from irsim.world.map import EnvGridMap

from repro.navigation.planning import plan, planner_map
from repro.prediction.stream import StreamMap

ORIGIN, RESOLUTION_M, SIZE = (-10.0, 20.0), 0.5, 40


def predicted(obstacles: list[tuple[float, float, float, float]]) -> StreamMap:
    """Create a map of 20 x 20 m with rectangular obstacles left, right, bottom, top [m]."""
    free = np.full((SIZE, SIZE), 0.9)
    centers = (np.arange(SIZE) + 0.5) * RESOLUTION_M
    x, y = ORIGIN[0] + centers, ORIGIN[1] + centers[::-1]  # row 0 is the top
    for left, right, bottom, top in obstacles:
        free[np.ix_((y > bottom) & (y < top), (x > left) & (x < right))] = 0.2
    return StreamMap(free, ORIGIN, RESOLUTION_M, 0.0)


def clearance(path: np.ndarray, obstacles) -> float:
    """Return the least distance of a path to the obstacles [m]."""
    share = np.linspace(0, 1, 20)[:, None]
    dense = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(path)])
    distances = []
    for left, right, bottom, top in obstacles:
        dx = np.maximum(np.maximum(left - dense[:, 0], dense[:, 0] - right), 0)
        dy = np.maximum(np.maximum(bottom - dense[:, 1], dense[:, 1] - top), 0)
        distances.append(np.hypot(dx, dy).min())
    return min(distances)


@pytest.mark.parametrize(
    ("radius_m", "above"), [(-1.0, 0.5), (np.nan, 0.5), (np.inf, 0.5), (0.3, 50.0), (0.3, np.nan), (0.3, -0.1)]
)
def test_a_radius_or_a_probability_that_cannot_be_is_refused(radius_m, above):
    with pytest.raises(ValueError, match="expected a robot_radius_m of at least 0 m and occupied_above from 0 to"):
        planner_map(predicted([]), radius_m, above)


WALL = [(-1.0, 1.0, 20.0, 35.0)]  # a gap at the top only
START, GOAL = np.array([-8.0, 22.0, 0.3]), np.array([8.0, 22.0])


def test_the_map_is_one_of_irsim():
    grid_map = planner_map(predicted(WALL))
    assert isinstance(grid_map, EnvGridMap)
    assert grid_map.obstacle_list == []
    assert grid_map.grid_occupied(0.0, 25.0)
    assert not grid_map.grid_occupied(0.0, 38.0)
    assert not grid_map.grid_occupied(-8.0, 22.0)


@pytest.mark.parametrize("planner", [None, JPSPlanner])
def test_a_path_goes_through_the_gap_of_a_predicted_wall(planner):
    options = {"planner": planner} if planner else {}
    path = plan(planner_map(predicted(WALL)), START, GOAL, **options)
    assert path[0] == pytest.approx(START[:2], abs=RESOLUTION_M)
    assert path[-1] == pytest.approx(GOAL, abs=RESOLUTION_M)
    assert path[:, 1].max() > 35
    assert clearance(path, WALL) > 0
    straight = plan(planner_map(predicted([])), START, GOAL, **options)
    assert np.ptp(straight[:, 1]) < 2 * RESOLUTION_M


def test_a_path_keeps_the_radius_of_the_robot():
    path = plan(planner_map(predicted(WALL), robot_radius_m=1.5), START, GOAL)
    assert clearance(path, WALL) >= 1.5 - RESOLUTION_M
    assert clearance(path, WALL) > clearance(plan(planner_map(predicted(WALL)), START, GOAL), WALL)


def test_what_is_an_obstacle_depends_on_the_probability():
    assert len(plan(planner_map(predicted(WALL), occupied_above=0.85), START, GOAL)) > 2
    path = plan(planner_map(predicted(WALL), occupied_above=0.85), START, GOAL)
    assert path[:, 1].max() < 24, "0.8 is free now"


@pytest.mark.parametrize(
    ("start", "goal", "obstacles", "message"),
    [
        (START, GOAL, [(-1, 1, 20, 40)], "no path from"),
        (START, np.array([0.0, 25.0]), WALL, "the goal .* is on an obstacle"),
        (START, np.array([11.0, 25.0]), [], "the goal .* is outside the map"),
        (np.array([0.0, 19.0]), GOAL, [], "the start .* is outside the map"),
    ],
)
def test_a_path_that_does_not_exist_is_an_error(start, goal, obstacles, message):
    with pytest.raises(ValueError, match=message):
        plan(planner_map(predicted(obstacles)), start, goal)


def test_planning_prints_nothing(capsys):
    plan(planner_map(predicted(WALL)), START, GOAL)
    assert capsys.readouterr().out == ""
