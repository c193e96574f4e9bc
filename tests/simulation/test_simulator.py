import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import world_spec

from repro.simulation.raycasting import scan
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.simulator import check_replay, make, simulate


def test_a_wall_ahead_is_measured_at_its_distance():
    wall = np.array([[[10.0, -5.0], [11.0, -5.0], [11.0, 5.0], [10.0, 5.0]]])
    angles = np.array([-math.pi / 4, 0.0, math.pi / 6, math.pi / 4])
    poses, states = np.array([[-5.0, 0.0, 0.0]]), np.array([[[10.5, 0.0, 0.0]]])
    ranges, seen = scan(poses, angles, wall - [10.5, 0.0], states, 30.0)
    assert ranges[0, 1] == pytest.approx(15.0)
    assert np.isinf(ranges[0, [0, 2, 3]]).all()
    assert seen.all()
    assert np.isinf(scan(poses, angles, wall - [10.5, 0.0], states, 14.9)[0]).all()


def test_only_hit_obstacles_are_seen():
    recording = simulate(sample_world(world_spec("1"), 0))
    scans, count = recording.scans, len(recording.seen)
    alone = [
        scan(scans.poses, scans.angles, recording.outlines[[k]], recording.states[[k]], 30.0)[0] for k in range(count)
    ]
    assert np.allclose(np.min(alone, axis=0), recording.scans.ranges)
    nearest = np.where(np.isfinite(recording.scans.ranges), np.argmin(alone, axis=0), -1)
    assert recording.seen.tolist() == [bool((nearest == k).any()) for k in range(len(recording.seen))]


def test_commands_beyond_the_limit_are_refused():
    world = sample_world(world_spec("2"), 0)
    world["robot"]["vel_max"] = [1.0, 1.0]
    with pytest.raises(ValueError, match="vel_max"):
        simulate(world)


def test_a_behavior_that_irsim_does_not_know_is_refused():
    world = sample_world(world_spec("2"), 0)
    world["robot"]["behavior"]["name"] = "dash"
    with pytest.raises(ValueError, match=r"'dash'.* is not active"):
        make(world)


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
