"""reproduce/robot_logs.py on logs of a simulated robot, and its measures against those of scikit-learn."""

import gzip
import importlib
import json
import math
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from sklearn.metrics import roc_auc_score

from repro.maps.grid import Grid
from repro.networks.predictor import load_predictor
from repro.prediction.agreement import Observed
from repro.scans import Scans
from repro.simulation.simulator import simulate
from repro.simulation.worlds import sample_world
from repro.world_config import read_world, world_spec

REPRODUCE = ROOT / "reproduce"


@pytest.fixture(scope="module")
def script():
    sys.path.insert(0, str(REPRODUCE))
    yield importlib.import_module("robot_logs")
    sys.path.remove(str(REPRODUCE))


@pytest.fixture(scope="module")
def evidence(script):
    return importlib.import_module("log_evidence")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Write CARMEN logs of a robot that drives through rooms, with a scan every 0.2 m and every 1 m, without times."""
    world = read_world(ROOT / "conf" / "world" / "rooms.yaml")
    world["experiments"]["people"]["motion"] |= {"steps": 300, "speed_m_s": 2.0, "turn_rad_s": 2.0}
    spec = world_spec(world, "people").with_lidar(angle_range=math.pi, number=181, range_max=80)
    scans = simulate(sample_world(spec, 100_011)).scans
    ranges = np.where(np.isinf(scans.ranges), 81.83, scans.ranges)
    directory, lines = tmp_path_factory.mktemp("logs"), []
    for readings, pose in zip(ranges, scans.poses, strict=True):
        words, place = (" ".join(f"{value:.6f}" for value in values) for values in (readings, pose))
        lines.append(f"FLASER 181 {words} {place} {place} 1.01893e+09 robot 1.01893e+09\n")
    for name, every in (("dense", 1), ("sparse", 5)):
        with gzip.open(directory / f"{name}.log.gz", "wt") as file:
            file.writelines(lines[::every])
    return sorted(directory.iterdir())


def test_the_measures_are_those_of_scikit_learn(script):
    rng = np.random.default_rng(0)
    hits, passed = rng.integers(0, 200, 500), rng.integers(50, 256, 3000)
    counts = np.stack([np.bincount(each, minlength=256) for each in (hits, passed)])
    auroc, found, free = script.measures(counts)
    truth = np.repeat([1, 0], [500, 3000])
    assert auroc == pytest.approx(roc_auc_score(truth, -np.concatenate([hits, passed])))
    assert (found, free) == pytest.approx(((hits < 127.5).mean(), (passed >= 127.5).mean()))


def wall_ahead() -> Scans:
    """One scan of a wall 5.25 m ahead of a robot at the center of a map of 50 m."""
    angles = np.linspace(-0.5, 0.5, 101)
    return Scans(np.repeat(5.25 / np.cos(angles)[None], 10, 0), angles, np.tile([25.0, 25.0, 0.0], (10, 1)))


def test_the_distance_map_ranks_hits_unseen_pixels_and_passed_pixels(evidence):
    seen_of = evidence.evidence_of(wall_ahead(), Grid(100, 50.0), 30.0)
    levels = evidence.distance_map(seen_of)
    row = levels[50]
    assert row[60] == 0
    assert row[61:65].tolist() == [128, 136, 141, 144]  # behind the wall, 1 to 4 px: 8 levels per octave
    assert row[59:55:-1].tolist() == [192, 200, 205, 208]  # passed
    assert seen_of.seen[50, 56:61].all()
    assert not seen_of.seen[50, 61:].any()
    assert levels[:, :40].max() < 192  # behind the robot


def test_the_score_ranks_passed_pixels_by_counts_and_unseen_ones_by_two_distances(evidence):
    seen_of = evidence.evidence_of(wall_ahead(), Grid(100, 50.0), 30.0)
    assert seen_of.odds[50, 57] == pytest.approx(math.log(10.5 / 0.5))  # passed in all ten parts
    assert seen_of.odds[50, 60] == pytest.approx(math.log(0.5 / 10.5))  # hit in all of them
    levels = evidence.score_map(seen_of, 0.15, 0.5)
    assert levels[50, 60] < 128 <= levels[50, 61] < levels[50, 70] < 192 <= levels[50, 59] < levels[50, 52]
    assert (evidence.score_map(seen_of, 0.15, 0.0)[50, 61:] >= levels[50, 61:]).all()  # far from passed pixels


def test_walls_are_continued_along_their_direction_and_not_from_single_hits(evidence):
    hit = np.zeros((64, 64), bool)
    hit[20, 10:30] = hit[50, 50] = True
    walls = evidence.continued_walls(hit, Grid(64, 25.0))
    assert walls[20, 10:42].all()  # 5 m are 12.8 px
    assert not walls[20, 44:].any()
    assert not walls[np.arange(64) != 20].any()


def test_whatever_is_fitted_is_from_other_logs(script, evidence):
    """A log whose truth is the opposite of the others does not change what is fitted for it."""
    rng = np.random.default_rng(0)

    def sample(sign):
        design = rng.normal(size=(200, 3))
        scores = [np.stack([np.bincount(rng.integers(0, 256, 50), minlength=256)] * 2) for _ in evidence.CONSTANTS]
        return script.Sample((design, design), sign * design[:, 0] > 0, scores)

    samples = {"a": sample(1), "b": sample(1), "c": sample(-1)}
    for tested, slope in (("c", 1), ("a", 0)):
        models = script.fit_others(samples, tested).models
        assert all((model[-1].coef_[0, 0] > 1) == (slope == 1) for model in models)
    assert script.fit_others(samples, "c").constants == script.fit_others({**samples, "c": sample(1)}, "c").constants


def test_a_map_that_knows_nothing_is_at_chance(script):
    """The tolerance of one pixel gives a noisy map no advantage."""
    rng = np.random.default_rng(0)
    counts = np.zeros((2, 256), dtype=int)
    for _ in range(40):
        hits = rng.random((64, 64)) < 0.02
        scan = Observed(hits, (rng.random((64, 64)) < 0.5) & ~hits)
        counts += next(script.count(rng.integers(0, 256, (64, 64)), scan, [np.ones((64, 64), bool)]))
    assert script.measures(counts)[0] == pytest.approx(0.5, abs=0.02)


def test_a_hit_beside_an_obstacle_counts_as_found_and_a_passed_pixel_beside_a_hit_not_at_all(script):
    levels, hits, passed = np.full((9, 9), 255), np.zeros((9, 9), bool), np.zeros((9, 9), bool)
    levels[4, 4] = 0
    hits[3, 3] = True
    passed[3, :3] = passed[5, :] = True  # (3, 2) is beside the hit, (5, 3) to (5, 5) are beside the obstacle
    above = np.arange(81).reshape(9, 9) < 36  # without the row of the obstacle and below
    everywhere, here = script.count(levels, Observed(hits, passed), (np.ones((9, 9), bool), above))
    assert everywhere[:, [0, 255]].tolist() == [[1, 0], [3, 8]]
    assert here[:, [0, 255]].tolist() == [[1, 0], [0, 2]]


def test_the_mean_over_logs_has_an_interval_and_a_gain(script):
    rows = []
    for log, (of_network, of_baseline) in {"a": (0.9, 0.8), "b": (0.8, 0.75), "c": (0.7, 0.75)}.items():
        for name, auroc in ((script.NETWORK, of_network), (script.SCORE, of_baseline)):
            counts = {"windows": 2, "hits": 10, "passed": 20, "hits_share": 0.5, "free_share": 1.0}
            rows += [
                {"weights": "w", "map": name, "pixels": p, "log": log, "auroc": auroc, **counts} for p in script.PIXELS
            ]
    means = script.with_means(pd.DataFrame(rows)).query("log == 'mean'").set_index(["map", "pixels"])
    network, score = (means.loc[(name, "unseen")] for name in (script.NETWORK, script.SCORE))
    assert (network["windows"], network["logs"]) == (6, 3)
    assert (network["auroc"], score["gain"]) == pytest.approx((0.8, 0.1 / 3))
    assert 0.699 < network["auroc_low"] < 0.8 < network["auroc_high"] < 0.901
    assert score["gain_low"] < 0 < score["gain_high"]  # the baseline is better in one of three logs


@pytest.mark.parametrize(
    ("name", "path_m"), [("rooms-16000/exppeople-convgru", 5.6), ("drive-16000/expmixed-convgru", 28)]
)
def test_the_robot_drives_as_far_as_in_the_training_or_past_ten_scans(script, logs, name, path_m):
    predictor = load_predictor(ROOT / "reproduce" / "results" / name)
    for log, most in zip(logs, (1.15, 1.15 if path_m > 10 else 2.2), strict=True):  # turns make paths shorter or longer
        windows = [window for window, _ in script.windows_of(log, predictor)]
        paths = [np.linalg.norm(np.diff(each.scans.poses[:, :2], axis=0), axis=1).sum() for each in windows]
        assert 0.7 * path_m < np.median(paths) < most * path_m
        assert all(len(np.unique(each.scans.poses, axis=0)) >= 10 for each in windows)


@pytest.mark.slow
def test_logs_whose_times_are_lost_are_compared(script, logs, tmp_path, monkeypatch):
    monkeypatch.setattr(script, "DRAWN", ("dense.log.gz", 2))
    weights = ("rooms-16000/exppeople-convgru", "drive-16000/expmixed-convgru")
    options = SimpleNamespace(logs=logs, weights=weights, target=tmp_path)
    monkeypatch.setattr("argparse.ArgumentParser.parse_args", lambda self: options)
    script.main()
    table = pd.read_csv(tmp_path / "held_out.csv")
    assert len(table) == 2 * 5 * 3 * 3  # weights, maps, pixels; two logs and their mean
    key = ["weights", "map", "pixels"]
    mean, *each = (
        table[table["log"] == log].set_index(key).sort_index() for log in ("mean", "dense.log.gz", "sparse.log.gz")
    )
    assert mean["auroc"].to_numpy() == pytest.approx(np.mean([rows["auroc"] for rows in each], axis=0), abs=1e-4)
    assert mean["windows"].tolist() == sum(rows["windows"] for rows in each).tolist()
    for name in ("hits", "passed"):
        counts = mean[name].unstack()
        assert (counts["seen"] + counts["unseen"] == counts["all"]).all()
    assert mean.loc[(weights[0], "network", "seen"), "auroc"] > 0.95
    assert mean.loc[(weights[0], "network", "unseen"), "auroc"] > 0.6
    assert (tmp_path / "window.png").is_file()
    provenance = json.loads((tmp_path / "provenance.json").read_text())
    assert list(provenance["logs"]) == ["dense.log.gz", "sparse.log.gz"]
    assert provenance["commit"]
