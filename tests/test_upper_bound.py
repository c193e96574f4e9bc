import math

import numpy as np
import pytest
from conftest import world_spec
from reproduce.upper_bound import count_cover, draw_ends, newest_hit, privileged
from scipy.stats import ks_2samp

from repro.evaluation.recency import newest_hits_of_obstacles
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import load_recorded
from repro.simulation.recorder import record_experiment
from repro.worlds.obstacle_motions import Drift

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
ANGLES = np.linspace(-0.5, 0.5, 21)


def scans_of(steps, length=30.0):
    """Return the scans of a robot that stands at (5, 25) and looks along x, all beams of the same range."""
    return np.full((steps, len(ANGLES)), length), ANGLES, np.tile([5.0, 25.0, 0.0], (steps, 1))


def behind(steps):
    """Return scans that see nothing of the map."""
    ranges, angles, poses = scans_of(steps)
    return ranges, angles, poses + np.array([0, 0, math.pi])


@pytest.fixture(scope="module", params=["1", "4"])
def test_set(request, tmp_path_factory):
    directory = tmp_path_factory.mktemp("recordings") / "exp"
    record_experiment(directory, world_spec(request.param), {"train": 2, "val": 2, "test": 60}, workers=1)
    return load_recorded(open_recordings(directory), "test", Grid(64, 50.0))


def test_the_counted_pixels_are_those_of_the_true_map():
    rng, grid = np.random.default_rng(0), Grid(64, 50.0)
    angle = np.sort(rng.uniform(0, 2 * np.pi, (40, 9)))
    outlines = 4 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ends = rng.uniform(-2, 52, (40, 2))
    maps = rasterize(outlines, np.pad(ends, ((0, 0), (0, 1))), np.arange(40), 40, grid)
    assert np.array_equal(count_cover(outlines, ends, grid.size_px, grid.size_m), (maps == 0).sum(0))


def test_the_newest_hits_are_those_of_the_analysis(recorded):
    shard = next(open_recordings(recorded).shards("test"))
    expected = newest_hits_of_obstacles(shard)
    ranges, angles, poses = (
        np.asarray(part, dtype=float) for part in (shard.scans.ranges, shard.scans.angles, shard.scans.poses)
    )
    for number, world in enumerate(shard.world):
        x, y = shard.outlines[number].astype(float).T
        heading = shard.states[number, 0, 2]
        corners = np.stack([x * np.cos(heading) - y * np.sin(heading), x * np.sin(heading) + y * np.cos(heading)], 1)
        path = shard.states[number, :, :2].astype(float)
        for twin in (0, 1):
            index = 2 * world + twin
            assert newest_hit(corners, path, ranges[index], angles, poses[index]) == expected[twin, number]


@pytest.mark.parametrize("place", [(38.0, 25.0), (31.0, 25.0)])  # far from the zone, and beside it
def test_drawn_motions_have_the_law_of_the_simulation(place):
    steps, motion = 140, {"speed_m_s": 0.6, "turn_steps": (50, 100), "center_m": (25.0, 25.0), "keep_out_m": 5.0}
    ends = []
    for seed in range(1500):
        (x, y), drift = place, Drift(seed=seed, **motion)
        for _ in range(steps):
            vx, vy = drift.velocity(x, y, 0.1)
            x, y = x + 0.1 * vx, y + 0.1 * vy
        ends.append((x, y))
    law, rng, drawn = (0.1, 25.0, 25.0, 5.0 - math.sqrt(2), 50, 100), np.random.default_rng(1), []
    for _ in range(1500):  # the first heading is random, no step has passed since it was drawn
        bearing = rng.uniform(-np.pi, np.pi)
        start = np.array([*place, 0.6 * np.cos(bearing), 0.6 * np.sin(bearing), 0])
        drawn.append(draw_ends(SQUARE, start, law, behind(steps), 1, 1, rng)[0][0])
    for axis in (0, 1):
        assert ks_2samp(np.array(ends)[:, axis], np.array(drawn)[:, axis]).pvalue > 0.01


def test_motions_into_observed_free_space_are_discarded():
    law, start = (0.1, 25.0, 25.0, -2.0, 50, 100), np.array([20.0, 17.0, 0.0, 1.0, 0])
    ends, tried = draw_ends(SQUARE, start, law, scans_of(40), 10, 50, np.random.default_rng(0))
    assert (len(ends), tried) == (0, 50)  # 4 m further the square is in view, and no beam ends on it
    hidden, _ = draw_ends(SQUARE, start, law, scans_of(40, length=10.0), 10, 50, np.random.default_rng(0))
    assert np.allclose(hidden, [20.0, 21.0])  # all beams end before it


@pytest.mark.slow
def test_the_probabilities_are_calibrated(test_set):
    """The predicted number of obstacle pixels is the true one within its error over worlds, also of unsure pixels."""
    free, settings = privileged(test_set, test_set)
    assert settings == {"draws": 512}
    occupied, truth = 1 - free[:, 0], 1 - test_set.maps[:, 0].astype(float)
    for low, high in ((0.0, 0.2), (0.2, 0.8), (0.8, 1.01)):
        chosen = (occupied >= low) & (occupied < high) & (occupied > 0)
        excess = np.where(chosen, truth - occupied, 0).sum((1, 2)).reshape(-1, 2).sum(1)  # a world and its twin
        assert abs(excess.mean()) <= 4 * excess.std() / math.sqrt(len(excess)) + 1e-9
