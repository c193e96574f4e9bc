from dataclasses import replace

import numpy as np
import pytest
from conftest import world_spec
from scipy.special import comb

from repro.baselines import association
from repro.baselines.association import explain, observe
from repro.baselines.draws import newest_hit
from repro.baselines.inference import _free_of_unseen, infer
from repro.baselines.laws import Obstacles, turned
from repro.baselines.privileged import privileged
from repro.maps.grid import Grid
from repro.recordings.recorded import load_recorded
from repro.simulation.recorder import record_experiment

STEPS = 100


@pytest.fixture(scope="module")
def test_set(tmp_path_factory):
    directory = tmp_path_factory.mktemp("recordings") / "exp"
    record_experiment(directory, world_spec("3"), {"train": 2, "val": 2, "test": 8}, workers=1)
    return load_recorded(directory, "test", Grid(64, 50.0))


@pytest.mark.slow
def test_obstacles_are_inferred_from_scans(test_set, monkeypatch):
    monkeypatch.setattr(association, "PARTICLES", 192)
    free, settings = infer(test_set, test_set)
    assert settings == {"particles": 192}
    truth = test_set.maps.float()
    squared = {
        "inference": (free - truth).square().mean().item(),
        "bound": (privileged(test_set, test_set)[0] - truth).square().mean().item(),
        "nothing": (truth.mean() - truth).square().mean().item(),
    }
    assert squared["bound"] < squared["inference"] < 0.6 * squared["nothing"]


@pytest.mark.slow
def test_every_obstacle_is_found_once(test_set):
    """Also those that the rotating robot sees at the start and again at the end."""
    differences = []
    for index in range(len(test_set)):
        parts = (test_set.scans.ranges[index], test_set.scans.angles, test_set.scans.poses[index])
        scanned = tuple(np.ascontiguousarray(part, dtype=float) for part in parts)
        known = turned(*test_set.truth.of_recording(index))
        hit = [newest_hit(*each, *scanned) > 0 for each in zip(known.corners, known.paths, strict=True)]
        seen = observe(scanned, 30.0, test_set.truth.spec, np.random.default_rng(index))
        found = explain(seen)
        assert len(np.unique(np.concatenate([each.hits for each in found]))) == sum(len(each.hits) for each in found)
        differences.append(len(found) - sum(hit))
    assert np.abs(differences).max() <= 1
    assert np.count_nonzero(differences) <= len(differences) // 3


def test_scans_without_hits_tell_of_no_obstacle():
    poses = np.tile([25.0, 25.0, 0.0], (STEPS, 1))
    seen = observe((np.full((STEPS, 9), np.inf), np.linspace(-0.7, 0.7, 9), poses), 30.0, world_spec("3"), None)
    assert explain(seen) == []


def test_the_number_of_unseen_obstacles_follows_from_that_of_those_found():
    grid, spec = Grid(64, 50.0), world_spec("3")
    others = Obstacles(np.array([[[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]]), np.full((1, 3, 2), 10.0))
    scanned = (np.full((3, 5), 0.1), np.linspace(-0.7, 0.7, 5), np.tile([25.0, 25.0, 0.0], (3, 1)))
    covered = others.corners[0] + 10.0
    inside = grid.size_px - 1 - int(covered[:, 1].mean() / grid.resolution_m), int(10 / grid.resolution_m)
    assert _free_of_unseen(others, scanned, spec, 10, grid)[inside] == 1  # at most 10 in a world
    assert _free_of_unseen(others, scanned, spec, 6, grid)[inside] == 0  # at least 7
    weights = np.array([comb(n, 8) for n in (8, 9, 10)])  # unseen with certainty, each number as likely before
    assert _free_of_unseen(others, scanned, spec, 8, grid)[inside] == pytest.approx(weights[0] / weights.sum())


DRIFT = world_spec("3").raw["obstacles"]["behavior"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fixed": [{"shape": {"name": "circle", "radius": 1.0}}]}, "one population of discs and rectangles"),
        (
            {"obstacles": {"behavior": {**DRIFT, "turn_steps": [10, 30]}}},
            r"one random turn in 100 steps: .* at least 50, got \[10, 30\]",
        ),
    ],
)
def test_other_laws_are_refused(test_set, change, message):
    other = replace(test_set, truth=replace(test_set.truth, spec=world_spec("3", **change)))
    with pytest.raises(ValueError, match=message):
        infer(other, other)


def test_wide_lidars_are_refused(test_set):
    wide = replace(test_set, scans=replace(test_set.scans, angles=2.5 * test_set.scans.angles))
    with pytest.raises(ValueError, match="less than 180 degrees"):
        infer(wide, wide)
