import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import world_spec

from repro.simulation.raycasting import scan
from repro.simulation.simulator import beam_angles, check_replay, make, replay, simulate
from repro.simulation.worlds import reverse_direction, sample_world, write_world


@pytest.mark.parametrize("seed", [0, 7])
def test_a_replay_by_plain_irsim_agrees(spec, seed, tmp_path):
    for world in (sample_world(spec, seed), reverse_direction(sample_world(spec, seed))):
        write_world(world, tmp_path / "world.yaml")
        truth, found = replay(tmp_path / "world.yaml"), simulate(world)
        hit = np.isfinite(truth.scans.ranges)
        assert np.array_equal(hit, np.isfinite(found.scans.ranges))
        assert np.allclose(truth.scans.ranges[hit], found.scans.ranges[hit], rtol=0, atol=1e-9)
        for name in ("angles", "poses"):
            assert np.allclose(getattr(truth.scans, name), getattr(found.scans, name), rtol=0, atol=1e-9), name
        for name in ("states", "outlines"):
            assert np.allclose(getattr(truth, name), getattr(found, name), rtol=0, atol=1e-9), name
        assert truth.seen is None  # IR-SIM does not tell


def test_ranges_agree_with_rays_against_discs():
    """Compare with the distance to a disc; IR-SIM's discs are 64-gons, within 9 mm except at grazing beams."""
    world = sample_world(world_spec("3", obstacles={"disc_share": 1.0}), 11)
    recording = simulate(world)
    heading = recording.scans.poses[:, 2:] + recording.scans.angles
    beams = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    oracle = np.full(recording.scans.ranges.shape, np.inf)
    depth = np.zeros(recording.scans.ranges.shape)  # how far inside the disc the beam passes
    for obstacle, states in zip(world["obstacle"], recording.states, strict=True):
        offset, radius = states[:, :2] - recording.scans.poses[:, :2], obstacle["shape"]["radius"]
        along = np.einsum("td,tnd->tn", offset, beams)
        inside = radius**2 - (offset**2).sum(-1)[:, None] + along**2
        distance = np.where((inside > 0) & (along > 0), along - np.sqrt(np.maximum(inside, 0)), np.inf)
        depth = np.where(distance < oracle, inside, depth)
        oracle = np.minimum(oracle, distance)
    clear = (depth > 0.5) & (oracle < 29.9)
    assert clear.sum() > 500
    error = np.abs(oracle[clear] - recording.scans.ranges[clear])
    assert error.max() < 0.05
    assert np.median(error) < 0.009
    assert np.isinf(recording.scans.ranges[np.isinf(oracle)]).all()


def test_a_wall_ahead_is_measured_at_its_distance():
    wall = np.array([[[10.0, -5.0], [11.0, -5.0], [11.0, 5.0], [10.0, 5.0]]])
    angles = np.array([-math.pi / 4, 0.0, math.pi / 6, math.pi / 4])
    poses, states = np.array([[-5.0, 0.0, 0.0]]), np.array([[[10.5, 0.0, 0.0]]])
    ranges, seen = scan(poses, angles, wall - [10.5, 0.0], states, 30.0)
    assert ranges[0, 1] == pytest.approx(15.0)
    assert np.isinf(ranges[0, [0, 2, 3]]).all()
    assert seen.all()
    assert np.isinf(scan(poses, angles, wall - [10.5, 0.0], states, 14.9)[0]).all()


def test_rotating_everything_leaves_the_scan_unchanged():
    recording = simulate(sample_world(world_spec("1"), 2))
    turn = 0.7
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])

    def turned(poses):
        return np.concatenate([poses[..., :2] @ matrix.T, poses[..., 2:] + turn], axis=-1)

    again, _ = scan(
        turned(recording.scans.poses), recording.scans.angles, recording.outlines, turned(recording.states), 30.0
    )
    hit = np.isfinite(recording.scans.ranges) & np.isfinite(again)
    assert (np.isfinite(recording.scans.ranges) == np.isfinite(again)).mean() > 0.999
    assert np.allclose(recording.scans.ranges[hit], again[hit], atol=1e-6)


def test_only_hit_obstacles_are_seen():
    recording = simulate(sample_world(world_spec("1"), 0))
    scans, count = recording.scans, len(recording.seen)
    alone = [
        scan(scans.poses, scans.angles, recording.outlines[[k]], recording.states[[k]], 30.0)[0] for k in range(count)
    ]
    assert np.allclose(np.min(alone, axis=0), recording.scans.ranges)
    nearest = np.where(np.isfinite(recording.scans.ranges), np.argmin(alone, axis=0), -1)
    assert recording.seen.tolist() == [bool((nearest == k).any()) for k in range(len(recording.seen))]


def test_twins_share_the_obstacle_motion():
    world = sample_world(world_spec("4"), 9)
    assert np.array_equal(simulate(world).states, simulate(reverse_direction(world)).states)


def test_beams_span_the_field_of_view():
    angles = beam_angles(world_spec("1").lidar.irsim())
    assert len(angles) == 100
    assert np.degrees(angles[[0, -1]]) == pytest.approx([-45, 45])


def test_an_obstacle_on_the_robot_is_refused():
    world = sample_world(world_spec("1"), 0)
    world["obstacle"][0]["state"][:2] = [25.0, 25.0]
    with pytest.raises(ValueError, match="reaches the robot"):
        simulate(world)


def test_commands_beyond_the_limit_are_refused():
    world = sample_world(world_spec("2"), 0)
    world["robot"]["vel_max"] = [1.0, 1.0]
    with pytest.raises(ValueError, match="vel_max"):
        simulate(world)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "cannot be read \\(.*No such file"),
        ("", "cannot be read \\(expected a mapping, got NoneType"),
        ("a: [", "cannot be read \\("),
        ("experiments: {}", "lacks world, robot, obstacle"),
    ],
)
def test_what_is_no_world_file_is_refused(content, problem, tmp_path):
    path = tmp_path / "world.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=f"world.yaml {problem}.*: expected a world that task=world wrote"):
        make(path)


def test_a_behavior_that_irsim_skipped_is_refused(tmp_path):
    world = sample_world(world_spec("3"), 0)
    del world["obstacle"][0]["behavior"]["speed_m_s"]
    write_world(world, tmp_path / "world.yaml")
    with pytest.raises(ValueError, match="not active"):
        make(tmp_path / "world.yaml")


def test_replay_check_notices_another_scan():
    world = sample_world(world_spec("2"), 0)
    recording = simulate(world)
    assert check_replay(world, recording) < 1e-9
    with pytest.raises(ValueError, match="plain IR-SIM"):
        check_replay(world, simulate(reverse_direction(world)))
    scans = recording.scans
    for changed in (replace(scans, poses=scans.poses + 1e-3), replace(scans, angles=scans.angles / 2)):
        with pytest.raises(ValueError, match="plain IR-SIM differs by"):
            check_replay(world, replace(recording, scans=changed))
