"""Worlds as wide as real buildings: walls with a thickness, people who stop, robots that stand, sensors with errors."""

import numpy as np
import pytest
import shapely
from conftest import ROOT, world_errors

from repro.scans import Scans
from repro.simulation import recorder
from repro.simulation.rooms import sample_rooms
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.sensing import drifted_poses, sensed, skipped_scans
from repro.simulation.shapes import geometry, shape_radius, union
from repro.simulation.simulator import check_replay, drive_robot, simulate
from repro.system.errors import InputError
from repro.worlds.obstacle_motions import Walk
from repro.worlds.obstacles import Cabinets
from repro.worlds.robot_motions import drive_of
from repro.worlds.spec import Sensing, read_world, world_spec

SPEC = world_spec(read_world(ROOT / "conf" / "world" / "places.yaml"), "people")
SHARP = {"range_m": (30, 30), "noise_m": (0, 0), "lost_share": (0, 0), "every_beam": (1, 1), "every_step": (1, 1)}
NONE = Sensing(**SHARP, odometry=(0, 0), pose_m=(0, 0))  # of the errors
STANDING = SPEC.model_copy(
    update={"motion": SPEC.motion.model_copy(update={"standing": SPEC.motion.standing.model_copy(update={"share": 1})})}
)


@pytest.mark.parametrize("spec", [SPEC, STANDING])
def test_plain_irsim_records_the_same_and_the_robot_keeps_clear(spec):
    world = sample_world(spec.model_copy(update={"motion": spec.motion.model_copy(update={"steps": 40})}), 0)
    walls = union(world["obstacle"][: world["custom"]["fixed"]])
    for twin in (world, reverse_direction(world)):
        check_replay(twin, simulate(twin))
        places = drive_robot(twin)[:, :2]
        assert shapely.distance(walls, shapely.LineString(places)) >= 0.3 - 1e-6
        assert places.min() >= 5 - 1e-6
        assert places.max() <= 20 + 1e-6


@pytest.mark.parametrize("spec", [SPEC, STANDING])
def test_nobody_starts_in_a_thick_wall_or_a_cabinet(spec):
    boxes = 0
    for seed in range(6):
        world = sample_world(spec, seed)
        fixed = world["custom"]["fixed"]
        lines = [shapely.LineString(obstacle["shape"]["vertices"]) for obstacle in world["obstacle"][:fixed]]
        solid = shapely.union_all([shapely.Polygon(line) for line in lines if line.is_closed])
        boxes += len([line for line in lines if line.is_closed])
        for item in [world["robot"], *world["obstacle"][fixed:]]:
            assert solid.distance(shapely.Point(item["state"][:2])) >= shape_radius(item["shape"]) - 1e-9
    assert boxes > 100


def test_twins_of_a_robot_that_stands_look_the_other_way():
    world = sample_world(STANDING, 0)
    poses, twins = drive_robot(world), drive_robot(reverse_direction(world))
    start = world["robot"]["state"]
    assert np.array_equal(poses[:, :2], np.tile(start[:2], (100, 1)))
    assert np.cos(poses[:, 2] + twins[:, 2] - 2 * start[2]) == pytest.approx(1)


def test_a_sweep_swings_about_its_heading():
    swing = {"swing_rad": 0.8, "period_s": 4.0, "phase_rad": 0.0}
    commands = drive_of({"name": "sweep", "direction": 1, "pose": [5, 5, 0], **swing, "steps": 40}).commands(0.1)
    headings = np.cumsum(commands[:, 1] * 0.1)
    assert not commands[:, 0].any()
    assert headings.max() == pytest.approx(0.8, abs=0.01)
    assert headings.min() == pytest.approx(-0.8, abs=0.01)
    assert headings[-1] == pytest.approx(0, abs=1e-9)


def walked(**changes: object) -> np.ndarray:
    """Return the speeds of 400 steps of a person [m/s]."""
    usual = {"way_steps": (5, 10), "turn_rad": 0.5, "stop_share": 0.5, "stop_steps": (3, 3)}
    person = Walk(seed=0, speed_m_s=1.3, center_m=(0, 0), keep_out_m=0.0, **{**usual, **changes})
    return np.array([person.velocity(0.0, 0.0, 0.1) for _ in range(400)])


def test_people_stop_for_the_given_steps_and_else_walk_at_their_speed():
    speeds = np.hypot(*walked().T)
    changes = np.flatnonzero(np.diff(speeds > 0, prepend=True))
    assert set(np.round(speeds, 9)) == {0, 1.3}
    assert set(np.diff(changes)[::2]) == {3}
    assert np.hypot(*walked(stop_share=0.0).T) == pytest.approx(1.3)


def test_walls_have_the_thickness_drawn_and_closed_doors_shut_the_rooms():
    change = {"thickness_m": (0.3, 0.3), "closed_share": 1.0, "cabinets": None}
    obstacles = sample_rooms(np.random.default_rng(0), SPEC.rooms.model_copy(update=change), 25.0)
    walls = [np.array(obstacle["shape"]["vertices"]) for obstacle in obstacles]
    thick = [wall for wall in walls if len(wall) == 5]
    assert all(np.linalg.norm(wall[2] - wall[1]) == pytest.approx(0.3) for wall in thick)
    lines = shapely.union_all([shapely.LineString(wall) for wall in walls])
    places = shapely.points(np.random.default_rng(0).uniform(5, 20, (20, 2)))
    parts = shapely.box(0, 0, 25, 25).difference(lines.buffer(0.01)).geoms
    assert sum(part.contains(places).any() for part in parts) > 1


@pytest.mark.parametrize("seed", [1_000_196, 5_000_028])
def test_floors_whose_union_fails_by_rounding_are_sampled(seed):
    world = sample_world(SPEC, seed)
    assert union(world["obstacle"][: world["custom"]["fixed"]]).is_valid


def test_cabinets_stand_against_a_wall():
    cabinets = Cabinets(per_m=(0.5, 0.5), length_m=(0.5, 1.0), depth_m=(0.4, 0.4))
    change = {"cabinets": cabinets, "closed_share": 0.0, "leaf_share": 0.0, "thickness_m": None}
    obstacles = sample_rooms(np.random.default_rng(1), SPEC.rooms.model_copy(update=change), 25.0)
    lines = [geometry(obstacle["shape"]) for obstacle in obstacles]
    walls = shapely.union_all([line for line in lines if not line.is_closed])
    boxes = [line for line in lines if line.is_closed]
    nearest = [wall for box in boxes if (wall := shapely.distance(walls, box)) > 1e-9]
    assert len(boxes) > 10
    assert len(nearest) < len(boxes) / 5  # those whose wall is not on the map


def scans() -> Scans:
    ranges = np.tile(np.linspace(2, 20, 100)[:, None], (1, 90))
    ranges[:, ::7] = np.inf
    poses = np.stack([np.linspace(0, 5, 100), np.zeros(100), np.zeros(100)], axis=1)
    return Scans(ranges, np.linspace(-0.7, 0.7, 90), poses)


def sensed_with(**changes: object) -> Scans:
    return sensed(scans(), NONE.model_copy(update=changes), 30.0, np.random.default_rng(0))


def test_a_lidar_without_errors_changes_nothing():
    assert np.array_equal(sensed_with().ranges, scans().ranges)
    assert np.allclose(sensed_with().poses, scans().poses)


def test_errors_of_the_lidar_are_those_asked_for():
    exact = scans().ranges
    near = sensed_with(range_m=(8, 8)).ranges
    assert np.nanmax(near) <= 8
    assert np.array_equal(np.isfinite(near), exact <= 8)
    assert not np.isinf(near).any()  # a lidar that reaches less far does not tell a miss from a far hit
    assert np.isnan(sensed_with(lost_share=(0.2, 0.2)).ranges).mean() == pytest.approx(0.2, abs=0.02)
    assert np.array_equal(np.isnan(sensed_with(every_beam=(3, 3)).ranges), np.tile(np.arange(90) % 3 != 0, (100, 1)))
    assert len(np.unique(sensed_with(every_step=(10, 10)).poses[:, 0])) == 10
    hit = np.isfinite(exact)
    noise = sensed_with(noise_m=(0.1, 0.1)).ranges[hit] - exact[hit]
    assert noise.std() == pytest.approx(0.1, rel=0.05)


def test_odometry_drifts_within_the_window():
    drifted = sensed_with(odometry=(0.1, 0.1)).poses
    assert drifted[-1] == pytest.approx(scans().poses[-1])
    assert abs(drifted[0, 0]) > 1e-3
    noise = sensed_with(pose_m=(0.1, 0.1)).poses - scans().poses
    assert noise[:-1].std(axis=0) == pytest.approx([0.1, 0.1, 0.005], rel=0.2)
    assert not noise[-1].any()


def test_the_errors_of_odometry_add_up_along_a_circle():
    angle = np.linspace(0, 2 * np.pi, 101)
    poses = np.stack([5 * np.cos(angle), 5 * np.sin(angle), angle + np.pi / 2], axis=-1)[None]
    circle = Scans(np.full((1, 101, 3), 10.0), np.linspace(-0.7, 0.7, 3), poses)

    class Errors:
        def normal(self, mean, std, shape):
            assert (mean, shape) == (0, (2, 1, 1))
            return np.array([0.1, -0.05]).reshape(shape)  # of distances and of turns

    drifted = drifted_poses(circle, 0.1, Errors()).poses[0]
    assert drifted[-1] == pytest.approx(poses[0, -1])
    steps = np.diff(drifted[:, :2], axis=0)
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(1.1 * 2 * np.pi * 5, rel=1e-3)
    assert drifted[-1, 2] - drifted[0, 2] == pytest.approx(0.95 * 2 * np.pi)
    # each step points along the heading, as that of the circle does, up to half a step of the turn
    assert np.cos(np.arctan2(steps[:, 1], steps[:, 0]) - drifted[:-1, 2]) == pytest.approx(1, abs=1e-3)


def test_a_step_takes_the_nearest_of_the_scans_that_are_left():
    steps = np.arange(7.0)
    window = Scans(np.tile(steps[:, None], (2, 1, 3)), np.zeros(3), np.tile(steps[:, None], (2, 1, 3)))
    slower = skipped_scans(window, 2, np.random.default_rng(0))
    assert slower.ranges[1, :, 0].tolist() == slower.poses[1, :, 0].tolist() == [0, 0, 3, 3, 3, 6, 6]


def test_recordings_have_the_errors_of_the_sensors(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "check_replay", lambda *_: 0.0)  # see above
    recorder.record_experiment(tmp_path, SPEC, {"train": 2}, workers=1)
    with np.load(tmp_path / "train-0000.npz") as content:
        assert np.isnan(content["ranges"]).any()


def test_a_margin_without_a_place_is_refused():
    motion = SPEC.motion.model_copy(update={"margin_m": 12.5})
    with pytest.raises(InputError, match=r"no place at 12.5 m or more from the border"):
        sample_world(SPEC.model_copy(update={"motion": motion}), 0)


def test_errors_of_a_behavior_are_named_as_they_are_written():
    world = read_world(ROOT / "conf" / "world" / "places.yaml")
    world["obstacles"]["people"]["behavior"] |= {"stop_steps": [5, 2]}
    assert [error.key for error in world_errors(world)] == ["world.obstacles.people.behavior.stop_steps"]
