"""Worlds other than the paper's: all shapes, walls, noise and drives, compared with plain IR-SIM and shapely."""

import copy
import math
from typing import Any

import numpy as np
import pytest
import shapely
from conftest import ROOT
from shapely import LineString, Point

import repro.worlds.spec
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.shapes import geometry, shape_radius, union
from repro.simulation.simulator import check_replay, simulate
from repro.worlds.obstacle_motions import obstacle_states
from repro.worlds.spec import WorldSpec

SHAPES = {
    "circle": {"name": "circle", "radius": 1.3},
    "rectangle": {"name": "rectangle", "length": 3.0, "width": 1.0},
    "triangle": {"name": "polygon", "vertices": [[0, 0], [2, 0.5], [0.3, 1.7]]},
    "concave": {"name": "polygon", "vertices": [[-2, -1], [2, -1], [2, 2], [1, 2], [1, 0], [-1, 0], [-1, 2], [-2, 2]]},
    "wall": {"name": "linestring", "vertices": [[-2, 0], [2, 0.3]]},
    "corner": {"name": "linestring", "vertices": [[-2, 1], [0, 0], [2, 1.5], [3, -1]]},
}
GOALS = {"name": "random_goals", "speed_m_s": 1.5, "turn_rad_s": 2.0, "steps": 60}
DISCS = {"count": [2, 4], "radius_m": [0.3, 0.6], "aspect": [1.0, 2.0], "disc_share": 0.5}
WALKERS = {**DISCS, "behavior": {"name": "drift", "speed_m_s": [0.3, 1.5], "turn_steps": [10, 30]}}


def own_spec(*, lidar: dict[str, Any] | None = None, **changes: Any) -> WorldSpec:
    """Return a world of 20 x 20 m with one obstacle of each shape, in which a robot drives to random goals."""
    turns = [0.0, 0.4, -1.0, 2.0, 0.7, 3.0]
    places = [[4, 4], [16, 5], [10, 16], [4, 13], [15, 12], [10, 7]]
    sensor = {"type": "lidar2d", "range_min": 0, "range_max": 12, "angle_range": 2.0, "number": 61, **(lidar or {})}
    robot = {"kinematics": {"name": "diff"}, "shape": {"name": "circle", "radius": 0.3}}
    limits = {"vel_min": [-5, -5], "vel_max": [5, 5], "sensors": [sensor]}
    content = {
        "experiment": "own",
        "world": {"width": 20, "height": 20, "step_time": 0.1, "collision_mode": "unobstructed"},
        "robot": robot | limits,
        "motion": GOALS,
        "obstacles": [DISCS, WALKERS],
        "clear_radius_m": 0.5,
        "fixed": [
            {"shape": shape, "state": [*place, turn]}
            for shape, place, turn in zip(SHAPES.values(), places, turns, strict=True)
        ],
        **changes,
    }
    return WorldSpec.parse(content)


def both(spec: WorldSpec, seed: int) -> tuple[dict, dict]:
    world = sample_world(spec, seed)
    return world, reverse_direction(world)


@pytest.mark.parametrize("name", ["paper", "office", "drive", "rooms"])
def test_the_worlds_of_conf_agree_with_plain_irsim(name):
    world = repro.worlds.spec.read_world(ROOT / "conf" / "world" / f"{name}.yaml")
    for experiment in world["experiments"]:
        for item in both(repro.worlds.spec.world_spec(world, experiment), 3):
            assert check_replay(item, simulate(item)) < 1e-9


@pytest.mark.parametrize("fov", [0.5, math.pi, 2 * math.pi])
@pytest.mark.parametrize("noise", [{}, {"noise": True, "std": 0.05}], ids=["exact", "noise"])
def test_all_shapes_agree_with_plain_irsim(fov, noise):
    for item in both(own_spec(lidar={"angle_range": fov, "number": 91, **noise}), 5):
        recording = simulate(item)
        assert check_replay(item, recording) < 1e-9


@pytest.mark.parametrize("moving", SHAPES)
def test_moving_shapes_agree_with_plain_irsim(moving):
    behavior = {"name": "drift", "speed_m_s": [0.3, 1.0], "turn_steps": [10, 30]}
    shapes = {"count": [3, 3], "shapes": [SHAPES[moving]], "behavior": behavior}
    world = sample_world(own_spec(obstacles=shapes, fixed=[]), 1)
    assert {obstacle["shape"]["name"] for obstacle in world["obstacle"]} == {SHAPES[moving]["name"]}
    assert check_replay(world, simulate(world)) < 1e-9


def test_ranges_agree_with_rays_against_shapely():
    spec = own_spec(lidar={"angle_range": 2 * math.pi, "number": 72})
    world = sample_world(spec, 8)
    recording = simulate(world)
    hits = 0
    for step in (0, 30, 59):
        parts = [
            geometry(obstacle["shape"], state)
            for obstacle, state in zip(world["obstacle"], recording.states[:, step], strict=True)
        ]
        scene = shapely.union_all([part.boundary if part.geom_type == "Polygon" else part for part in parts])
        x, y, heading = recording.scans.poses[step]
        for angle, found in zip(recording.scans.angles, recording.scans.ranges[step], strict=True):
            end = (x + 12 * math.cos(heading + angle), y + 12 * math.sin(heading + angle))
            crossing = scene.intersection(LineString([(x, y), end]))
            truth = math.inf if crossing.is_empty else crossing.distance(Point(x, y))
            assert found == pytest.approx(truth, abs=1e-6)
            hits += math.isfinite(truth)
    assert hits > 100


def test_noise_has_its_deviation_and_is_reproducible():
    exact, noisy = (sample_world(own_spec(lidar=noise), 4) for noise in ({}, {"noise": True, "std": 0.05}))
    first, again = simulate(noisy).scans.ranges, simulate(copy.deepcopy(noisy)).scans.ranges
    assert np.array_equal(first, again)
    twin = reverse_direction(noisy)
    assert twin["custom"]["seed"] != noisy["custom"]["seed"]
    assert reverse_direction(twin) == noisy
    assert noisy["custom"]["seed"] != sample_world(own_spec(lidar={"noise": True, "std": 0.05}), 6)["custom"]["seed"]
    truth = simulate(exact).scans.ranges
    hit = np.isfinite(truth) & np.isfinite(first)
    error = first[hit] - truth[hit]
    assert hit.sum() > 1000
    assert error.std() == pytest.approx(0.05, rel=0.1)
    assert abs(error.mean()) < 0.01
    raw = copy.deepcopy(own_spec(lidar={"noise": True, "std": 0.05}).raw)
    del raw["robot"]["sensors"][0]["range_min"]
    assert np.array_equal(simulate(sample_world(WorldSpec.parse(raw), 4)).scans.ranges, first)


def test_beams_through_a_corner_are_left_to_plain_irsim():
    motion = {"name": "waypoints", "points_m": [[4.9, 5], [5, 5]], "speed_m_s": 1.0, "turn_rad_s": 1.0, "steps": 20}
    room = [{"shape": {"name": "linestring", "vertices": [[1, 1], [9, 1], [9, 9], [1, 9], [1, 1]]}}]
    content = {"lidar": {"angle_range": math.pi, "number": 181}, "fixed": room, "obstacles": []}
    aligned = sample_world(own_spec(**content, motion=motion), 0)
    recording = simulate(aligned)
    assert check_replay(aligned, recording) == 0
    assert np.isfinite(recording.scans.ranges).mean() > 0.99
    turned = sample_world(own_spec(**content, motion={**motion, "points_m": [[4.9, 5], [5, 5.123]]}), 0)
    assert 0 < check_replay(turned, simulate(turned)) < 1e-9


def test_a_first_beam_through_a_corner_is_left_to_plain_irsim_with_noise():
    """With noise, IR-SIM also scans before the first step, and all later noise depends on the hits of that scan."""
    motion = {"name": "waypoints", "points_m": [[4, 4], [16, 4]], "speed_m_s": 1.37, "turn_rad_s": 3.0, "steps": 3}
    lidar = {"range_max": 10, "angle_range": math.pi / 2, "number": 91, "noise": True, "std": 0.01}
    corners = [[[4.5, 4.5], [4.5, 7.5], [3.5, 7.5]], [[12, 1], [13, 1], [13, 3], [12, 3]]]
    fixed = [{"shape": {"name": "polygon", "vertices": corner_points}} for corner_points in corners]
    world = sample_world(own_spec(lidar=lidar, fixed=fixed, obstacles=[], motion=motion), 0)
    assert check_replay(world, simulate(world)) == 0


ROOMS = repro.worlds.spec.world_spec(repro.worlds.spec.read_world(ROOT / "conf" / "world" / "rooms.yaml"), "people")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("spec", [own_spec(), ROOMS], ids=["shapes", "rooms"])
def test_obstacles_are_off_the_walls_and_out_of_the_way_of_robot_and_twin(spec, seed):
    world, twin = both(spec, seed)
    paths = [simulate(item).scans.poses[:, :2] for item in (world, twin)]
    fixed = world["custom"]["fixed"]
    walls = union(world["obstacle"][:fixed])
    for obstacle in world["obstacle"][fixed:]:
        places = shapely.points(obstacle_states(obstacle, spec.steps, 0.1)[:, :2])
        radius = shape_radius(obstacle["shape"])
        assert shapely.distance(walls, places).min() >= radius - 1e-9
        for path in paths:
            assert shapely.distance(shapely.points(path), places).min() >= radius + spec.clear_radius_m - 1e-9
    for path in map(LineString, paths):
        assert path.distance(walls) >= 0.3 - 1e-9
        side = spec.world.width - 0.3
        assert shapely.box(0.3, 0.3, side, side).buffer(1e-9).covers(path)


def test_goals_are_reproducible_and_differ_between_worlds():
    points = [sample_world(own_spec(), seed)["robot"]["behavior"]["points_m"] for seed in (1, 1, 2)]
    assert points[0] == points[1]
    assert points[0] != points[2]
    drives = [simulate(sample_world(own_spec(), seed)).scans.poses for seed in range(4)]
    assert all(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).max() <= 0.15 + 1e-9 for poses in drives)
    turns = [np.abs(np.angle(np.exp(1j * np.diff(poses[:, 2])))).max() for poses in drives]
    assert max(turns) <= 0.2 + 1e-9
    assert min(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum() for poses in drives) > 3


def test_ranges_of_the_speeds_are_sampled_for_each_world():
    ranges = {"speed_m_s": [0.5, 1.5], "turn_rad_s": [1.0, 2.0]}
    sampled = [sample_world(own_spec(motion={**GOALS, **ranges}), seed)["robot"]["behavior"] for seed in range(8)]
    for key, (low, high) in ranges.items():
        values = [behavior[key] for behavior in sampled]
        assert low <= min(values) < (low + high) / 2 < max(values) <= high
        assert len(set(values)) == 8


@pytest.mark.parametrize(("shape", "offset"), [("concave", (0, 0.5)), ("circle", (1, 0)), ("rectangle", (0.4, 0.4))])
def test_a_robot_in_an_obstacle_is_refused(shape, offset):
    world = sample_world(own_spec(), 0)
    x, y = np.add(simulate(world).scans.poses[30, :2], offset).tolist()
    world["obstacle"].append({"shape": SHAPES[shape], "state": [x, y, 0.0], "kinematics": {"name": "static"}})
    with pytest.raises(ValueError, match="reaches the robot"):
        simulate(world)


def test_a_robot_in_the_bay_of_a_concave_obstacle_sees_it_all_around():
    shape = {"name": "polygon", "vertices": [[-3, -3], [3, -3], [3, 3], [2, 3], [2, -2], [-2, -2], [-2, 3], [-3, 3]]}
    motion = {"name": "waypoints", "points_m": [[10, 10], [10.3, 10.4]], "speed_m_s": 1, "turn_rad_s": 1, "steps": 5}
    fixed = [{"shape": shape, "state": [10, 10, 0.1]}]
    lidar = {"angle_range": 2 * math.pi, "number": 100}
    world = sample_world(own_spec(lidar=lidar, fixed=fixed, obstacles=[], motion=motion), 0)
    recording = simulate(world)
    assert check_replay(world, recording) < 1e-9
    assert 0.6 < np.isfinite(recording.scans.ranges).mean() < 0.95
