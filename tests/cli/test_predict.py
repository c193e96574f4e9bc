"""task=predict on the example log, and on logs that cannot be used."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT, run_py

from repro.cli.tasks.predict import name_of
from repro.maps.statistics import TITLES
from repro.networks.predictor import load_predictor
from repro.prediction.stream import PredictionStream
from repro.scans import Scans

pytestmark = pytest.mark.slow
WEIGHTS = ROOT / "reproduce" / "results" / "rooms-16000" / "exppeople-convgru"
SQUARE = WEIGHTS.parents[1] / "workstation-16000" / "exp4-convgru"  # trained on one path
EXAMPLE = ROOT / "examples" / "rooms.npz"


def paths(ends: list[int]) -> list[float]:
    """Return the length of the path in the 100 steps before each end."""
    poses = np.load(EXAMPLE)["poses"]
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return [steps[end - 100 : end - 1].sum() for end in ends]


@pytest.fixture
def predict(python):
    """Return a function that calls the task."""
    return partial(run_py, "task=predict", python=python)


@pytest.mark.parametrize(("reading", "least", "most"), [(np.nan, 0.75, 1.0), (np.inf, 0.0, 0.7)])
def test_lost_beams_hide_no_obstacle_if_they_are_invalid_and_many_if_they_are_misses(reading, least, most):
    predictor, log = load_predictor(WEIGHTS), np.load(EXAMPLE)
    ranges, poses = log["ranges"][:100], log["poses"][:100]
    lost = np.random.default_rng(0).random(ranges.shape) < 0.25
    windows = [Scans(read, log["angles"], poses) for read in (ranges, np.where(lost, reading, ranges))]
    before, after = (predictor.predict(window)[0] < 0.5 for window in windows)
    assert least <= (before & after).sum() / (before | after).sum() <= most


def test_a_log_without_a_maximum_range_and_with_a_jump_is_reported(tmp_path, predict):
    log = dict(np.load(EXAMPLE))
    del log["range_max_m"]
    log["ranges"] = np.minimum(log["ranges"], 15.0)  # a driver that reports misses at the maximum range
    log["poses"][150:, 0] += 5.0
    np.savez(tmp_path / "log.npz", **log)
    options = (
        "prediction.stride_s=100",
        "prediction.weights=rooms",
        "prediction.center=[12.5,12.5]",
        f"outputs={tmp_path}",
    )
    done = predict(f"scans={tmp_path / 'log.npz'}", *options)
    assert "the maximum range of the lidar is not known: a miss shows free space up to 30 m" in done.stdout
    assert "warning: the poses jump 1 times, the first by 5.1 m at 15.0 s" in done.stdout


def test_the_example_is_predicted_as_by_the_predictor(tmp_path, predict):
    options = ("prediction.stride_s=10", "prediction.weights=rooms", "prediction.center=[12.5,12.5]")
    done = predict(f"scans={EXAMPLE}", *options, f"outputs={tmp_path}")
    assert done.returncode == 0, done.stderr
    directory = tmp_path / "predictions" / "rooms"
    names = {f"window-{number:04d}.{kind}" for number in (1, 2, 3) for kind in ("npz", "pgm", "yaml", "png")}
    assert {path.name for path in directory.iterdir()} == names | {"windows.csv", "maps.html", "source.json"}
    table = pd.read_csv(directory / "windows.csv")
    assert table["stamp"].tolist() == pytest.approx([9.9, 19.9, 29.9])
    assert table["next_scan_log_loss"][:2].between(0, 0.5).all()
    assert (table["moving_pixels"] == 0).all()  # though people walk in the rooms, none is seen to
    assert done.stdout.count("window ") >= 3
    assert table["outside_training"].isna().all()
    assert "warning: " not in done.stdout
    assert set(TITLES) <= set(table)
    assert table["fov_deg"].tolist() == pytest.approx([90] * 3)
    assert table["path_m"].to_numpy() == pytest.approx(paths([100, 200, 300]), abs=1e-3)

    log = np.load(EXAMPLE)
    scans = Scans(log["ranges"][100:200], log["angles"], log["poses"][100:200])
    free = load_predictor(WEIGHTS).predict(scans)[0]
    with np.load(directory / "window-0002.npz") as content:
        stream = PredictionStream(load_predictor(WEIGHTS), log["angles"], center=(12.5, 12.5))
        maps = [stream.update(*scan) for scan in zip(log["ranges"], log["poses"], log["stamps"][:200], strict=False)]
        assert np.array_equal(content["free"], maps[199].free)
        assert content["free"] == pytest.approx(free, abs=1e-3)
        assert content["origin"].tolist() == [0, 0]


def test_windows_unlike_those_of_the_training_are_named(tmp_path, predict):
    options = ("prediction.stride_s=10", f"prediction.weights={SQUARE}", f"outputs={tmp_path}")
    done = predict(f"scans={EXAMPLE}", *options)  # its robot drives through rooms, slower than that of the training
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "predictions" / "rooms" / "windows.csv")
    with_age = "hit_share occupied_share hit_age_steps hit_range_m path_m turn_deg beams"
    assert table["outside_training"].tolist() == [with_age, with_age.replace("hit_age_steps ", ""), with_age]
    assert done.stdout.count("warning: ") == 7
    assert "length of the path of the robot [m]: 7.53 to 9.69 in 3 of 3 windows, 39.5 in the training" in done.stdout


@pytest.mark.parametrize(
    ("log", "name"),
    [
        ("a/rooms.npz", "rooms"),
        ("2024.01.05.bag", "2024.01.05"),
        ("run.log.gz", "run"),
        (".x.npz", "x"),
        ("bag/.", "bag"),
        ("bag/sub/..", "bag"),
    ],
)
def test_predictions_have_the_name_of_the_log(log, name, tmp_path, monkeypatch):
    (tmp_path / "bag" / "sub").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    assert name_of(Path(log)) == name
