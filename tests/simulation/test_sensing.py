import numpy as np
import pytest

from repro.scans import Scans
from repro.simulation.sensing import drifted_poses, noisy_poses, noisy_ranges, skipped_scans


@pytest.fixture
def scans():
    ranges = np.full((4, 50, 60), 10.0)
    ranges[:, :, ::3] = np.inf
    return Scans(ranges, np.linspace(-0.7, 0.7, 60), np.zeros((4, 50, 3)))


def test_noise_has_the_given_deviation_and_keeps_misses(scans):
    noisy = noisy_ranges(scans, 0.2, np.random.default_rng(0))
    hit = np.isfinite(scans.ranges)
    assert np.array_equal(hit, np.isfinite(noisy.ranges))
    assert (noisy.ranges[hit] - scans.ranges[hit]).std() == pytest.approx(0.2, rel=0.05)
    moved = noisy_poses(scans, 0.2, np.random.default_rng(0)).poses
    assert moved[..., 0].std() == pytest.approx(0.2, rel=0.15)
    assert moved[..., 2].std() == pytest.approx(0.01, rel=0.15)


def test_odometry_drifts_away_from_the_newest_pose():
    angle = np.linspace(0, 2 * np.pi, 101)
    circle = np.stack([5 * np.cos(angle), 5 * np.sin(angle), angle + np.pi / 2], axis=-1)[None]
    scans = Scans(np.full((1, 101, 3), 10.0), np.linspace(-0.7, 0.7, 3), np.angle(np.exp(1j * circle * [0, 0, 1])))
    scans = Scans(scans.ranges, scans.angles, np.concatenate([circle[..., :2], scans.poses[..., 2:]], axis=-1))

    class Errors:
        def normal(self, mean, std, shape):
            assert (mean, shape) == (0, (2, 1, 1))
            return np.array([0.1, -0.05]).reshape(shape)  # of distances and of turns

    drifted = drifted_poses(scans, 0.1, Errors()).poses[0]
    assert drifted[-1] == pytest.approx([5, 0, drifted[-1, 2]])
    assert np.cos(drifted[-1, 2] - circle[0, -1, 2]) == pytest.approx(1)
    lengths = np.linalg.norm(np.diff(drifted[:, :2], axis=0), axis=1)
    assert lengths.sum() == pytest.approx(1.1 * 2 * np.pi * 5, rel=1e-3)
    assert drifted[-1, 2] - drifted[0, 2] == pytest.approx(0.95 * 2 * np.pi)
    # each step points along the heading, as that of the circle does, up to half a step of the turn
    direction = np.arctan2(*np.diff(drifted[:, :2], axis=0).T[::-1])
    assert np.cos(direction - drifted[:-1, 2]) == pytest.approx(1, abs=1e-3)


def test_a_step_takes_the_nearest_of_the_scans_that_are_left():
    steps = np.arange(7.0)
    scans = Scans(np.tile(steps[:, None], (2, 1, 3)), np.zeros(3), np.tile(steps[:, None], (2, 1, 3)))
    slower = skipped_scans(scans, 2, np.random.default_rng(0))
    assert slower.ranges[1, :, 0].tolist() == slower.poses[1, :, 0].tolist() == [0, 0, 3, 3, 3, 6, 6]
