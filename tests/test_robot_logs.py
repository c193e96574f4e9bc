"""reproduce/real on logs of simulated lidars, and its measures against those of scikit-learn."""

import gzip
import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from matplotlib.figure import Figure
from reproduce.real import __main__ as script
from reproduce.real import fitting, measures
from reproduce.real import logs as real_logs
from reproduce.real.adapted import SOURCE, adapted
from reproduce.real.evidence import Evidence, continued_walls, evidence_of, score_map
from sklearn.metrics import roc_auc_score

from repro.learning import adaptation
from repro.learning.held_out import View, stands, swinging
from repro.learning.networks.trained import load_trained
from repro.maps.grid import Grid
from repro.metrics import calibration
from repro.metrics.counts import PROBABILITY
from repro.prediction.agreement import Observed
from repro.prediction.logs import ScanLog
from repro.scans import Scans
from repro.simulation.simulator import simulate
from repro.simulation.worlds import sample_world
from repro.world_config import read_world, world_spec

ROOMS, DRIVE = "rooms-16000/exppeople-convgru", "drive-16000/expmixed-convgru"


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


def test_the_measures_are_those_of_scikit_learn():
    rng = np.random.default_rng(0)
    hits, passed = rng.integers(0, 200, 500), rng.integers(50, 256, 3000)
    counts = np.stack([np.bincount(each, minlength=256) for each in (hits, passed)])
    auroc, brier, _, found, free, error = measures.measures(counts, PROBABILITY)
    truth, level = np.repeat([0, 1], [500, 3000]), np.concatenate([hits, passed])
    assert auroc == pytest.approx(roc_auc_score(truth, level))
    assert brier == pytest.approx(((level / 255 - truth) ** 2).mean())
    assert (found, free) == pytest.approx(((hits < 127.5).mean(), (passed >= 127.5).mean()))
    assert error == pytest.approx(calibration.calibration_error(calibration.reliability(counts)), abs=2e-3)
    assert np.isnan(measures.measures(counts * [[0], [1]], PROBABILITY)[0])  # no hits


def wall_ahead() -> Scans:
    """Ten scans of a wall 5.25 m ahead of a robot at the center of a map of 50 m."""
    angles = np.linspace(-0.5, 0.5, 101)
    return Scans(np.repeat(5.25 / np.cos(angles)[None], 10, 0), angles, np.tile([25.0, 25.0, 0.0], (10, 1)))


def test_the_score_ranks_passed_pixels_by_counts_and_unseen_ones_by_two_distances():
    evidence = evidence_of(wall_ahead(), Grid(100, 50.0), 30.0)
    assert evidence.odds[50, 57] == pytest.approx(math.log(10.5 / 0.5))  # passed in all ten parts
    assert evidence.odds[50, 60] == pytest.approx(math.log(0.5 / 10.5))  # hit in all of them
    levels = score_map(evidence, 0.15, 0.5)
    assert levels[50, 60] < 128 <= levels[50, 61] < levels[50, 70] < 192 <= levels[50, 59] < levels[50, 52]
    assert (score_map(evidence, 0.15, 0.0)[50, 61:] >= levels[50, 61:]).all()  # far from passed pixels


def test_walls_are_continued_along_their_direction_and_not_from_single_hits():
    hit = np.zeros((64, 64), bool)
    hit[20, 10:30] = hit[50, 50] = True
    slanted = np.eye(64, dtype=bool) & (np.arange(64) >= 40)
    walls = continued_walls(hit, Grid(64, 25.0))
    assert walls[20, 10:42].all()  # 5 m are 12.8 px
    assert not walls[20, 44:].any()
    assert not walls[np.arange(64) != 20].any()
    rows, columns = np.nonzero(continued_walls(slanted, Grid(64, 25.0)))
    assert np.abs(rows - columns).max() <= 1
    assert set(range(32, 64)) <= set(rows[rows == columns])
    assert min(rows) >= 30  # 9 px along each axis


def sample_of(rng: np.random.Generator, sign: int) -> fitting.Sample:
    """Draw pixels whose truth follows from the odds, or from their opposite."""
    kinds = rng.integers(0, 3, (400, 1)) + np.zeros((1, 9), int)
    values = {name: np.repeat(rng.normal(size=(400, 1)), 9, 1) for name in Evidence.__annotations__}
    evidence = Evidence(**{**values, "hit": kinds == 0, "seen": kinds < 2})
    free = sign * evidence.odds[:, 0] > 0
    return fitting.Sample(evidence, np.where(free, 200, 50), free)


def test_whatever_is_fitted_is_from_other_logs():
    """A log whose truth is the opposite of the others changes the fit of theirs and not its own."""
    rng = np.random.default_rng(0)
    samples = {"a": sample_of(rng, 1), "b": sample_of(rng, 1), "c": sample_of(rng, -1)}
    for_c, for_a = (fitting.fit_others(samples, tested) for tested in ("c", "a"))
    tested = samples["a"].evidence
    levels, mixed = (fitting.maps_of(tested, fitted)[fitting.REGRESSION][:, 0] for fitted in (for_c, for_a))
    assert roc_auc_score(samples["a"].free, levels) > 0.95
    assert roc_auc_score(samples["a"].free, mixed) < 0.9
    other = {**samples, "c": replace(samples["c"], free=~samples["c"].free, network=255 - samples["c"].network)}
    again = fitting.fit_others(other, "c")
    assert again.constants == for_c.constants
    for name, probability in for_c.probability.items():
        assert np.array_equal(probability, again.probability[name])


def test_a_map_that_knows_nothing_is_at_chance():
    """The tolerance of one pixel gives a noisy map no advantage."""
    rng = np.random.default_rng(0)
    counts = np.zeros((3, 2, 256), dtype=int)
    for _ in range(40):
        hits, seen, moving = (rng.random((64, 64)) < share for share in (0.02, 0.7, 0.5))
        clear = Observed(hits, (rng.random((64, 64)) < 0.5) & ~hits)
        groups = [clear, clear.within(seen), Observed(hits & moving, clear.passed)]
        pixels = np.flatnonzero(clear.hits | clear.passed)
        levels = rng.integers(0, 256, 64 * 64)[measures.neighbors(pixels, 64)]
        counts += measures.count(levels, groups, pixels)
    assert measures.auroc(counts) == pytest.approx([0.5] * 3, abs=0.03)


def test_a_hit_beside_an_obstacle_counts_as_found():
    levels, hits, passed = np.full((9, 9), 255), np.zeros((9, 9), bool), np.zeros((9, 9), bool)
    levels[4, 4] = 0
    hits[3, 3] = hits[0, 0] = True
    passed[3, :2] = passed[5, :] = True  # (5, 3) to (5, 5) are beside the obstacle
    above = np.arange(81).reshape(9, 9) < 36  # without the row of the obstacle and below
    clear = Observed(hits, passed)
    pixels = np.flatnonzero(hits | passed)
    nearby = levels.ravel()[measures.neighbors(pixels, 9)]
    everywhere, here = measures.count(nearby, [clear, clear.within(above)], pixels)
    assert everywhere[:, [0, 255]].tolist() == [[1, 1], [3, 8]]
    assert here[:, [0, 255]].tolist() == [[1, 1], [0, 2]]


def test_the_mean_over_logs_has_an_interval_and_a_difference():
    def measured(*aurocs: float) -> measures.Measured:
        """Return a log with a block per AUROC."""
        counts = np.zeros((len(aurocs), 1, 2, 256))
        for block, auroc in zip(counts[:, 0], aurocs, strict=True):
            block[0, 100], block[1, 50], block[1, 200] = 10, 100 * (1 - auroc), 100 * auroc
        return measures.Measured(2, counts, PROBABILITY)

    maps = {
        "network": {"a": measured(0.9, 0.7), "b": measured(0.8), "c": measured(0.7)},
        "score": {"a": measured(0.8, 0.5), "b": measured(0.75), "c": measured(0.75)},
    }
    rows = pd.DataFrame(measures.rows_of(maps, ("all",), "network")).set_index(["map", "log"])
    network, score = rows.loc[("network", "mean")], rows.loc[("score", "mean")]
    assert (network["windows"], network["logs"], network["hits"]) == (6, 3, 40)
    assert (network["auroc"], score["less_auroc"]) == pytest.approx((2.3 / 3, 0.15 / 3))
    assert 0.699 < network["auroc_low"] < 2.3 / 3 < network["auroc_high"] < 0.901
    assert score["less_auroc_low"] < 0 < score["less_auroc_high"]  # the score is better in one of three logs
    blocks = measures.drawn(maps["network"]["a"], 0)[:, 0, 0]
    assert sorted(set(blocks.round(6))) == pytest.approx([0.7, 0.8, 0.9])  # one block twice, or both


@pytest.mark.parametrize(("name", "path_m"), [(ROOMS, 5.6), (DRIVE, 28)])
def test_the_robot_drives_as_far_as_in_the_training_or_past_ten_scans(logs, name, path_m):
    predictor = load_trained(ROOT / "reproduce" / "results" / name)
    for log, most in zip(logs, (1.15, 1.15 if path_m > 10 else 2.2), strict=True):  # turns make paths shorter or longer
        windows = [case.window for case in real_logs.driving(log, predictor)]
        paths = [np.linalg.norm(np.diff(each.scans.poses[:, :2], axis=0), axis=1).sum() for each in windows]
        assert 0.7 * path_m < np.median(paths) < most * path_m
        assert all(len(np.unique(each.scans.poses, axis=0)) >= 10 for each in windows)


def standing_lidar(people: bool) -> ScanLog:
    """Return 15 s of a lidar of 270 degrees in a round room of 5 m, with somebody at 3 m in the last 2 s."""
    angles, stamps = np.linspace(-0.75 * math.pi, 0.75 * math.pi, 541), np.arange(0, 15, 0.1)
    ranges = np.full((len(stamps), len(angles)), 5.0, dtype=np.float32)
    if people:
        ranges[130:, np.abs(angles + 1.4) < 0.05] = 3.0
    return ScanLog(stamps, ranges, angles, np.zeros((len(stamps), 3)), range_max_m=11.0)


def test_a_virtual_lidar_swings_and_has_the_beams_that_it_sees():
    log = standing_lidar(people=False)
    assert stands(log)
    log = replace(log, ranges=np.broadcast_to(log.angles, log.ranges.shape))  # each reading tells its angle
    virtual, _ = swinging(log, View())
    assert virtual.poses[:, 2].min() == pytest.approx(-math.pi / 4, abs=0.01)
    assert virtual.poses[:, 2].max() == pytest.approx(math.pi / 4, abs=0.01)
    assert np.ptp(virtual.angles) == pytest.approx(math.pi / 2, abs=0.01)
    assert virtual.ranges == pytest.approx(virtual.angles + virtual.poses[:, 2:])


def test_hits_on_people_are_told_from_those_on_what_stands(monkeypatch):
    predictor = load_trained(ROOT / "reproduce" / "results" / ROOMS)
    monkeypatch.setattr(real_logs, "read_log", lambda *_: standing_lidar(people=True))
    cases = list(real_logs.standing(Path("people.bag"), predictor))
    for case in cases:
        x, y = predictor.grid.centers()[np.flatnonzero(case.moving)].T - predictor.grid.size_m / 2
        assert bool(case.moving.any()) == (case.window.stamp > 12.95)
        assert np.hypot(x, y) == pytest.approx(3, abs=0.2)
        groups = case.groups(np.zeros(len(case.pixels), bool))
        assert (groups["standing"].hits | groups["moving"].hits == case.clear.hits).all()
        view = case.window.scans.poses[-1, 2] + np.array([-math.pi / 4, math.pi / 4])
        x, y = predictor.grid.centers()[np.flatnonzero(case.clear.hits)].T - predictor.grid.size_m / 2
        angles = np.arctan2(y, x)
        assert not ((angles > view[0] + 0.05) & (angles < view[1] - 0.05)).any()  # held out
        assert np.abs(angles).max() < math.pi / 2 + 0.05  # as far as the lidar swings
    assert [case.block for case in cases] == [0] * len(cases)


@pytest.mark.slow
def test_logs_whose_times_are_lost_are_compared(logs, tmp_path, monkeypatch):
    weights = (ROOMS, DRIVE)
    options = SimpleNamespace(logs=logs, weights=weights, target=tmp_path, kept=tmp_path / "kept", folds=0, save=None)
    monkeypatch.setattr("argparse.ArgumentParser.parse_args", lambda self: options)
    script.main()
    kept = {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*.npz")}
    assert len(kept) == 4
    first = (tmp_path / "held_out.csv").read_text()
    monkeypatch.setattr(script.Predictor, "predict", None)  # a second comparison takes the maps that were kept
    monkeypatch.setattr(script, "draw", lambda *_: Figure())
    script.main()
    assert (tmp_path / "held_out.csv").read_text() == first
    table = pd.read_csv(tmp_path / "held_out.csv")
    assert len(table) == 2 * 4 * 3 * 3  # weights, maps, pixels; two logs and their mean
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
    assert (tmp_path / "windows.png").is_file()
    provenance = json.loads((tmp_path / "provenance.json").read_text())
    assert list(provenance["logs"]) == ["dense.log.gz", "sparse.log.gz"]
    assert provenance["commit"]


@pytest.mark.slow
def test_a_network_is_tested_on_logs_to_which_it_was_not_adapted(logs, tmp_path, monkeypatch):
    predictor, tested = load_trained(ROOT / "reproduce" / "results" / ROOMS), []
    monkeypatch.setattr(adaptation, "SCHEDULE", replace(adaptation.SCHEDULE, max_epochs=1, learning_rate=1e-4))
    monkeypatch.setattr(adaptation, "TRAINED_WINDOWS", 1)
    monkeypatch.setattr(adaptation, "MAX_WINDOWS", 8)
    origin, checksums = {"weights": "some"}, {path: path.name for path in logs}
    networks = adapted(predictor, origin, checksums, tmp_path, 2)
    for number, path in enumerate(logs):
        source = json.loads((tmp_path / f"fold-{number}" / SOURCE).read_text())
        assert len(source.pop("adaptation")) == 64
        assert source == origin | {other.name: other.name for other in logs if other != path}
        tested.append(next(iter(real_logs.driving(path, networks[path]))).window.scans)
    maps = [networks[path].predict(scans) for path, scans in zip(logs, tested, strict=True)]
    assert not any(np.array_equal(one, predictor.predict(scans)) for one, scans in zip(maps, tested, strict=True))
    monkeypatch.setattr("reproduce.real.adapted.adapt", None)  # a second call reads them
    again = adapted(predictor, origin, checksums, tmp_path, 2)
    assert all(
        np.array_equal(one, again[path].predict(scans)) for path, one, scans in zip(logs, maps, tested, strict=True)
    )
