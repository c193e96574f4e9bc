import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
import torch
from conftest import ROOT, world_spec

from repro import world_config
from repro.evaluation import generalization
from repro.evaluation.generalization import score, updated
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.networks.predictor import Predictor, load_predictor
from repro.recordings.recorded import Recorded, load_recorded
from repro.reporting.results import read_rows
from repro.scans import Scans
from repro.simulation.raycasting import scan
from repro.simulation.recorder import record_experiment
from repro.simulation.worlds import sample_world
from repro.system.errors import InputError


@pytest.fixture(scope="module")
def predictor(evaluated):
    return load_predictor(evaluated.model)


@pytest.fixture
def scans():
    ranges = np.full((4, 50, 60), 10.0)
    ranges[:, :, ::3] = np.inf
    return Scans(ranges, np.linspace(-0.7, 0.7, 60), np.zeros((4, 50, 3)))


def test_noise_has_the_given_deviation_and_keeps_misses(scans):
    noisy = generalization.noisy_ranges(scans, 0.2, np.random.default_rng(0))
    hit = np.isfinite(scans.ranges)
    assert np.array_equal(hit, np.isfinite(noisy.ranges))
    assert (noisy.ranges[hit] - scans.ranges[hit]).std() == pytest.approx(0.2, rel=0.05)
    moved = generalization.noisy_poses(scans, 0.2, np.random.default_rng(0)).poses
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

    drifted = generalization.drifted_poses(scans, 0.1, Errors()).poses[0]
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
    slower = generalization.skipped_scans(scans, 2, np.random.default_rng(0))
    assert slower.ranges[1, :, 0].tolist() == slower.poses[1, :, 0].tolist() == [0, 0, 3, 3, 3, 6, 6]


def test_a_wider_view_has_more_beams_and_the_same_worlds():
    spec = world_spec("4")
    wide = generalization.with_field_of_view(spec, 180)
    assert wide.lidar.angle_range == pytest.approx(math.pi)
    assert wide.lidar.number == 200
    assert generalization.with_field_of_view(spec, 90).lidar.number == 100
    assert sample_world(spec, 7)["obstacle"] == sample_world(wide, 7)["obstacle"]
    near = generalization.with_range(spec, 10)
    assert near.lidar.range_max == 10
    assert sample_world(spec, 7)["obstacle"] == sample_world(near, 7)["obstacle"]
    fast = generalization.with_speed(spec, 2)
    assert fast.obstacles.behavior.speed_m_s == (0.4, 1.4)
    assert spec.obstacles.behavior.speed_m_s == (0.2, 0.7)


@pytest.fixture(scope="module", params=["1", "4"])
def plain(request, tmp_path_factory):
    directory = tmp_path_factory.mktemp("plain")
    record_experiment(directory, world_spec(request.param), {"test": 4}, workers=1)
    return load_recorded(directory, "test", Grid(64, 50.0))


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_turned_recordings_are_those_of_turned_worlds(plain, degrees):
    test = generalization.turned(plain, degrees)
    assert not np.array_equal(test.maps, plain.maps)
    for index in range(len(test)):
        outlines, states = test.truth.of_recording(index)
        owner = torch.zeros(len(outlines), dtype=torch.long)
        drawn = rasterize(torch.as_tensor(outlines), torch.as_tensor(states[:, -1]), owner, 1, test.grid)
        assert (test.maps[index] == drawn).float().mean() > 0.999  # but for centers of pixels on an edge
        poses, angles = test.scans.poses[index].numpy(), test.scans.angles.numpy()
        ranges, _ = scan(poses, angles, outlines, states, test.range_max_m)  # anew, by the recorder's ray casting
        recorded = test.scans.ranges[index].numpy()
        same = np.isfinite(ranges) == np.isfinite(recorded)
        assert same.mean() > 0.9999  # the recorded states are rounded to 32 bits
        both = same & np.isfinite(ranges)
        assert np.abs(ranges[both] - recorded[both]).max() < 1e-3
    with pytest.raises(InputError, match="multiple of 90 degrees, got 45"):
        generalization.turned(plain, 45)


@pytest.mark.parametrize(("range_max_m", "reach_m"), [(12, 12), (30, 30), (40, 30)])
def test_every_row_has_the_range_of_the_tested_lidar(tmp_path, monkeypatch, range_max_m, reach_m):
    spec, tested = generalization.with_range(world_spec("4"), range_max_m), []
    predictor = Predictor(None, create_encoding("series4", {"frames": 4, "range_max_m": 30.0}), Grid(32, 50.0))
    scans = Scans(torch.full((2, 5, 3), 5.0), torch.zeros(3), torch.zeros((2, 5, 3)))
    test = Recorded(scans, torch.ones(2, 1, 32, 32), predictor.grid, 30.0, 0.1)

    def keep(predictor, *_):
        tested.append(predictor.reach_m)
        return pd.DataFrame({"metric": ["accuracy"], "value": [1.0]})

    monkeypatch.setattr(generalization, "record_experiment", lambda *_, **__: None)
    monkeypatch.setattr(generalization, "load_recorded", lambda *_: test)
    monkeypatch.setattr(generalization, "score", keep)
    rows = generalization.under_changes(predictor, "4", spec, tmp_path, 2, workers=1).assign(reach_m=tested)
    is_range = rows["shift"] == "maximum range [m]"
    assert set(rows[~is_range]["reach_m"]) == {reach_m}
    assert rows[is_range]["reach_m"].tolist() == [10, 15, 20, 30]
    assert len(rows) == 35


def test_a_test_replaces_its_own_rows_only():
    columns = ["model", "encoding", "seed", "trained", "shift", "value"]
    kinds = [("unet", "projection", 0, name, shift) for name in "34" for shift in ("experiment", "beams dropped")]
    others = [("fpn", "projection", 0, "3", "experiment"), ("unet", "projection", 1, "3", "experiment")]
    earlier = pd.DataFrame([(*kind, 0.1) for kind in kinds] + [(*other, 0.2) for other in others])
    earlier.columns = columns
    new = pd.DataFrame([(*kinds[0], 0.3), (*kinds[2], 0.3), (*kinds[1], 0.3)], columns=columns)
    rows = updated(earlier, new)
    values = rows.set_index(columns[:-1])["value"].to_dict()
    assert values == {**dict.fromkeys(kinds[:3], 0.3), kinds[3]: 0.1, **dict.fromkeys(others, 0.2)}


def test_windows_without_a_hit_and_poses_off_the_map_are_scored(predictor, recorded):
    test = load_recorded(recorded, "test", predictor.grid)
    scans = Scans(*(part.clone() for part in (test.scans.ranges, test.scans.angles, test.scans.poses)))
    scans.ranges[0] = torch.inf
    scans.poses[1, :, 0] += 100
    assert score(predictor, dataclasses.replace(test, scans=scans)).value.notna().all()


@pytest.fixture(scope="module")
def changed_recordings(tmp_path_factory):
    """Return a directory of recordings that the networks of an experiment share."""
    return tmp_path_factory.mktemp("changed")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("weights", "published", "experiment"),
    [
        ("workstation-16000/exp4-convgru", "workstation-16000", "4"),
        ("workstation/exp4-unet", "workstation", "4"),
        ("drive-16000/expmixed-convgru", "drive-16000", "mixed"),
    ],
)
def test_the_published_rows_are_those_of_the_published_weights(
    weights, published, experiment, changed_recordings, monkeypatch
):
    changes = {"scans skipped": (generalization.skipped_scans, (4.0,))}
    amounts_of = {"CHANGES": changes, "FIELDS_OF_VIEW": (), "RANGES_M": (15,), "SPEEDS": (2,), "START_HEADINGS": (180,)}
    for name, amounts in amounts_of.items():
        monkeypatch.setattr(generalization, name, amounts)
    results = ROOT / "reproduce" / "results"
    world = ROOT / "conf" / "world" / ("paper.yaml" if experiment == "4" else "drive.yaml")
    spec = world_config.world_spec(world_config.read_world(world), experiment)
    predictor = load_predictor(results / weights)
    recordings = changed_recordings / experiment
    tables = [generalization.under_changes(predictor, experiment, spec, recordings, 200, workers=2)]
    if experiment == "4":
        record_experiment(recordings / "test", spec, {"test": 500}, workers=2)
        tables.append(generalization.across_start_headings(predictor, experiment, recordings / "test"))

    rows = read_rows(results / published / "analysis" / "generalization.csv")
    rows = rows[rows["model"] == weights.rpartition("-")[2]]
    both = pd.concat(tables).merge(rows, on=["shift", "trained", "tested", "metric"], suffixes=("", "_published"))
    of_all = {"scans skipped", "maximum range [m]", "obstacles' speed [times]"}
    assert set(both["shift"]) == (of_all | {"start heading [deg]"} if experiment == "4" else of_all)
    assert both["value"].to_numpy() == pytest.approx(both["value_published"].to_numpy(), abs=2e-3)
