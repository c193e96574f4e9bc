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
from reproduce.real import __main__ as script
from reproduce.real import floors, maps, measures, spoiled
from reproduce.real import logs as real_logs
from reproduce.real.adapted import SOURCE, adapted
from reproduce.real.evidence import COUNTS, Evidence, continued_walls
from sklearn.metrics import log_loss, roc_auc_score

from repro.learning import adaptation
from repro.learning.held_out import View, stands, swinging
from repro.logs.scan_log import ScanLog
from repro.maps.grid import Grid
from repro.metrics import calibration
from repro.metrics.counts import PROBABILITY
from repro.networks.predictor import load_predictor
from repro.prediction.agreement import Observed
from repro.scans import Scans, wrapped
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate
from repro.system.errors import InputError
from repro.worlds.spec import read_world, world_spec

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
    counts = np.stack([np.bincount(values, minlength=256) for values in (hits, passed)])
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
    evidence = Evidence(wall_ahead(), Grid(100, 50.0), 30.0)
    assert evidence.odds[50, 57] == pytest.approx(math.log(10.5 / 0.5))  # passed in all ten parts
    assert evidence.odds[50, 60] == pytest.approx(math.log(0.5 / 10.5))  # hit in all of them
    counts = evidence.counts(np.arange(100 * 100))
    levels = maps.score(counts, 0.15, 0.5).reshape(100, 100)
    assert levels[50, 60] < 128 <= levels[50, 61] < levels[50, 70] < 192 <= levels[50, 59] < levels[50, 52]
    assert (maps.score(counts, 0.15, 0.0).reshape(100, 100)[50, 61:] >= levels[50, 61:]).all()  # far from passed ones


def test_features_of_the_ray_and_of_lines_tell_where_a_wall_is():
    """The robot looks along x: a pixel behind the wall has it on its ray, one before has it ahead on the same line."""
    evidence = Evidence(wall_ahead(), Grid(100, 50.0), 30.0)
    behind, before, aside = (50 * 100 + 70, 50 * 100 + 55, 20 * 100 + 20)
    features = evidence.features(np.array([behind, before, aside]))
    *_, position, lines, ray = np.split(features, np.cumsum([len(COUNTS), 10, 12, 3, 16]), axis=1)
    assert position[:, 0] == pytest.approx([20.5, 5.5, -29.5], abs=0.6)  # along the heading [px]
    assert ray[:, 0].tolist() == [10, 0, 0]  # the parts with a hit on the way
    assert ray[:, 4].tolist() == [0, 10, 0]  # behind the pixel
    ahead = lines[:, 4:8]  # largest, summed, distance to the nearest, passes
    assert ahead[:, 0].tolist() == [0, 10, 0]
    assert ahead[1, 2] == 4  # the wall is five pixels ahead


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


def sample_of(rng: np.random.Generator, sign: int) -> maps.Sample:
    """Draw pixels whose truth follows from the odds, or from their opposite."""
    features = rng.normal(size=(2000, 57)).astype(np.float32)
    kinds = rng.integers(0, 3, 2000)
    features[:, :2] = np.stack([kinds == 0, kinds < 2], axis=1)
    return maps.Sample(features, sign * features[:, COUNTS.index("odds")] > 0)


def test_whatever_is_fitted_follows_the_logs_to_which_it_is_fitted():
    rng = np.random.default_rng(0)
    one, other, tested = (sample_of(rng, sign) for sign in (1, -1, 1))
    for sample, is_right in ((one, True), (other, False)):
        fitted = maps.fit([sample], maps.CANDIDATES[0])
        evidence = SimpleNamespace(features=lambda pixels: tested.features[pixels])
        predicted = fitted.predict(evidence, np.arange(2000))
        for name in (maps.REGRESSION, maps.BOOSTING):
            assert (roc_auc_score(tested.free, predicted[name]) > 0.95) == is_right, name


def test_the_mean_of_two_maps_has_the_mean_of_their_log_odds():
    assert maps.mixed(np.array([0.5, 0.9, 1.0]), np.array([0.8, 0.1, 1.0])) == pytest.approx([2 / 3, 0.5, 509 / 510])


def test_the_boosting_is_tuned_on_places_that_it_has_not_seen(monkeypatch):
    """Settings that fit noise are not chosen: the truth of each place follows one feature, and chance."""
    rng = np.random.default_rng(0)
    samples = {}
    for place in "abc":
        features = rng.normal(size=(1500, 57)).astype(np.float32)
        samples[place] = [maps.Sample(features, features[:, 3] + 2 * rng.normal(size=1500) > 0)]
    fine = {"max_iter": 20, "learning_rate": 0.1, "max_leaf_nodes": 4}
    noisy = {"max_iter": 300, "learning_rate": 0.5, "max_leaf_nodes": 64}
    monkeypatch.setattr(maps, "CANDIDATES", (noisy, fine))
    assert maps.tuned(samples) == fine


def test_logs_of_one_place_are_in_one_fold_and_all_folds_have_some():
    names = [f"{name}-corrected.log.gz" for name in ("freiburg-079", "freiburg-101", "freiburg-campus", "intel", "fhw")]
    folds = [real_logs.fold_of(Path(name)) for name in (*names, "positive_1.bag", "positive_7.bag")]
    assert folds == [0, 0, 0, 2, 2, 1, 1]
    assert real_logs.fold_of(Path("dense.log.gz")) in range(3)


def test_a_log_of_wean_hall_is_read(tmp_path):
    words = ["L", "100", "-50", "0.5", "125", "-50", "0.6", *["183"] * 90, *["8191"] * 90, "1.25"]
    (tmp_path / "robotdata1.log").write_text(f"O 1 2 3 4\n{' '.join(words)}\n{' '.join(words)}\n")
    log = real_logs.wean_hall(tmp_path / "robotdata1.log")
    assert (log.stamps.tolist(), log.poses[0].tolist()) == ([1.25, 1.25], [1.25, -0.5, 0.6])
    assert np.degrees(log.angles[[0, -1]]) == pytest.approx([-89.5, 89.5])
    assert log.ranges[0, :90] == pytest.approx(1.83)
    assert np.isinf(log.ranges[0, 90:]).all()


def test_logs_that_cannot_be_compared_are_named(tmp_path):
    carmen, plain, cut = (tmp_path / name for name in ("aces-corrected.log.gz", "belgioioso.log", "fhw.log.gz"))
    plain.write_text("FLASER 3 1 1 1 0 0 0 0 0 0 1 host 1\n")
    carmen.write_bytes(gzip.compress(plain.read_bytes()))
    cut.write_bytes(gzip.compress(plain.read_bytes())[:30])
    predictor = load_predictor(ROOT / "reproduce" / "results" / ROOMS)
    real_logs.check([carmen, plain], ["rooms"])
    with pytest.raises(InputError, match="no network"):
        real_logs.check([carmen, plain], [])
    with pytest.raises(InputError, match=r"two of 3 folds or more, .*, got those of 1"):
        real_logs.check([carmen, carmen], ["rooms"])
    with pytest.raises(InputError, match=r"expected a log, or the directory of a floor with occ_map\.npy"):
        real_logs.check([carmen, tmp_path], ["rooms"])
    with pytest.raises(InputError, match=r"belgioioso\.log: expected a log of Wean Hall"):
        list(real_logs.cases_of(plain, predictor))
    with pytest.raises(InputError, match=r"fhw\.log\.gz: expected a gzipped CARMEN file, got a damaged one"):
        list(real_logs.cases_of(cut, predictor))


def test_a_robot_drives_through_a_floor_whose_rooms_are_known_up_to_closed_doors(tmp_path):
    plan = np.full((200, 600), 254, np.uint8)  # 60 m x 20 m: two rooms with a door, and a closed one
    plan[[0, -1]] = plan[:, [0, 400, -1]] = 0
    plan[:, 198:200] = 0
    plan[20:30, 198:200] = 254  # the door, 17 to 18 m from the bottom
    np.save(tmp_path / floors.PLAN, plan)
    predictor = load_predictor(ROOT / "reproduce" / "results" / ROOMS)
    cases = list(real_logs.cases_of(tmp_path, predictor))
    assert real_logs.fold_of(tmp_path) is None
    way = np.concatenate([case.window.scans.poses[:, :2] + case.window.origin for case in cases])
    through = np.abs(way[:, 0] - 19.9) < 0.1
    assert through.any()  # the farthest place is in the other room
    assert (np.abs(way[through, 1] - 17.5) < 0.45).all()
    beside = []
    for case in cases:
        x, y = (predictor.grid.centers() + case.window.origin).T
        hits, passed = (which.ravel() for which in (case.clear.hits, case.clear.passed))
        assert (np.abs(x[hits] - 19.9) < 0.11).any() or (x[hits] > 39).any() or (x[hits] < 1).any()
        assert not passed[(x > 40.2) | (x < 0) | (y < 0) | (y > 20)].any()  # the closed room and what is outside
        scans = case.window.scans
        offsets = np.column_stack([x, y]) - case.window.origin - scans.poses[-1, :2]
        bearing = wrapped(np.arctan2(offsets[:, 1], offsets[:, 0]) - scans.poses[-1, 2])
        beside.append(np.abs(bearing)[case.shown.passed.ravel() & (np.linalg.norm(offsets, axis=1) > 1)])
        ahead = scans.poses[:, 2, None] + scans.angles
        for axis, bearing, length in ((0, np.cos(ahead), 60.0), (1, np.sin(ahead), 20.0)):
            ends = scans.poses[:, axis, None] + case.window.origin[axis] + scans.ranges * bearing
            assert ((ends > -0.01) & (ends < length + 0.01))[np.isfinite(scans.ranges)].all()
    angles = np.concatenate(beside)
    assert 0.7 < angles.min() < 0.85  # 45 degrees
    assert 1.4 < angles.max() < 1.7  # 90 degrees


def test_a_beam_ends_at_the_first_wall():
    is_wall = np.zeros((100, 100), bool)
    is_wall[:, 80] = True  # 8 m to the right
    ranges = floors.cast(is_wall, np.array([5.0, 5.0, 0.0]), np.radians([0.0, 30.0, 90.0]), 30.0)
    assert ranges[:2] == pytest.approx([3, 3 / math.cos(math.pi / 6)], abs=0.06)
    assert ranges[2] == np.inf


def test_a_pixel_is_compared_with_its_own_level_and_with_the_least_around_it():
    levels, hits, passed = np.full((9, 9), 255), np.zeros((9, 9), bool), np.zeros((9, 9), bool)
    levels[4, 4] = 0
    hits[3, 3] = hits[0, 0] = True
    passed[3, :2] = passed[5, :] = True  # (5, 3) to (5, 5) are beside the obstacle
    above = np.arange(81).reshape(9, 9) < 36  # without the row of the obstacle and below
    clear = Observed(hits, passed)
    pixels = np.flatnonzero(hits | passed)
    beside = levels.ravel()[measures.around(pixels, 9)]
    assert (beside[:, 4] == levels.ravel()[pixels]).all()
    groups = [clear, clear.within(above)]
    own, within = (measures.count(place, groups, pixels) for place in (beside[:, 4], beside.min(1)))
    assert own[0][:, [0, 255]].tolist() == [[0, 2], [0, 11]]
    assert within[0][:, [0, 255]].tolist() == [[1, 1], [3, 8]]
    assert within[1][:, [0, 255]].tolist() == [[1, 1], [0, 2]]


def test_the_mean_over_logs_has_an_interval_and_a_difference():
    def measured(*aurocs: float) -> measures.Measured:
        """Return a log with a block per AUROC."""
        counts = np.zeros((len(aurocs), 1, 2, 256))
        for block, auroc in zip(counts[:, 0], aurocs, strict=True):
            block[0, 100], block[1, 50], block[1, 200] = 10, 100 * (1 - auroc), 100 * auroc
        return measures.Measured(2, counts, PROBABILITY)

    found = {
        "network": {"a": measured(0.9, 0.7), "b": measured(0.8), "c": measured(0.7)},
        "score": {"a": measured(0.8, 0.5), "b": measured(0.75), "c": measured(0.75)},
    }
    sets = {"all 3": ["a", "b", "c"], "two": ["b", "c"]}
    rows = pd.DataFrame(measures.rows_of(found, ("all",), "network", sets)).set_index(["map", "logs"])
    network, score = rows.loc[("network", "all 3")], rows.loc[("score", "all 3")]
    assert (network["windows"], network["count"], network["hits"]) == (6, 3, 40)
    assert rows.loc[("network", "two"), "auroc"] == pytest.approx(0.75)
    assert (network["auroc"], score["less_auroc"]) == pytest.approx((2.3 / 3, 0.15 / 3))
    assert 0.699 < network["auroc_low"] < 2.3 / 3 < network["auroc_high"] < 0.901
    assert score["less_auroc_low"] < 0 < score["less_auroc_high"]  # the score is better in one of three logs
    blocks = measures.drawn(found["network"]["a"], 0)[:, 0, 0]
    assert sorted(set(blocks.round(6))) == pytest.approx([0.7, 0.8, 0.9])  # one block twice, or both


@pytest.mark.parametrize(("name", "path_m"), [(ROOMS, 5.6), (DRIVE, 28)])
def test_the_robot_drives_as_far_as_in_the_training_or_past_ten_scans(logs, name, path_m):
    predictor = load_predictor(ROOT / "reproduce" / "results" / name)
    for log, most in zip(logs, (1.15, 1.15 if path_m > 10 else 2.2), strict=True):  # turns make paths shorter or longer
        windows = [case.window for case in real_logs.driving(log, predictor)]
        paths = [np.linalg.norm(np.diff(window.scans.poses[:, :2], axis=0), axis=1).sum() for window in windows]
        assert 0.7 * path_m < np.median(paths) < most * path_m
        assert all(len(np.unique(window.scans.poses, axis=0)) >= 10 for window in windows)


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
    predictor = load_predictor(ROOT / "reproduce" / "results" / ROOMS)
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
def test_a_network_is_adapted_to_logs_of_other_places_and_compared(logs, tmp_path, monkeypatch):
    monkeypatch.setattr(adaptation, "SCHEDULE", replace(adaptation.SCHEDULE, learning_rate=1e-4))
    for name, value in {"EPOCHS": (1,), "TRAINED_WINDOWS": 1, "MAX_WINDOWS": 8, "DRAWS": 2}.items():
        monkeypatch.setattr(adaptation, name, value)
    monkeypatch.setattr(real_logs, "PLACES", ("dense", "sparse"))
    monkeypatch.setattr(real_logs, "MAX_WINDOWS", 12)
    monkeypatch.setattr(script, "count_cores", lambda: 1)  # other processes would not know of these limits
    weights = str(ROOT / "reproduce" / "results" / ROOMS)
    options = SimpleNamespace(
        logs=logs, adapted=weights, weights=["rooms"], target=tmp_path, kept=tmp_path / "kept", all=False
    )
    monkeypatch.setattr("argparse.ArgumentParser.parse_args", lambda self: options)
    script.main()
    for number, path in enumerate(logs):
        source = json.loads((tmp_path / "kept" / f"fold-{number}" / SOURCE).read_text())
        assert {other.name for other in logs if other.name in source} == {other.name for other in logs if other != path}
    monkeypatch.setattr("reproduce.real.adapted.adapt", None)  # a second call reads the networks
    networks = adapted(weights, logs, tmp_path / "kept")
    table = pd.read_csv(tmp_path / "held_out.csv")
    assert len(table) == 2 * 6 * 3 * (1 + 2)  # scores, maps, pixels; their mean and two logs
    key = ["score", "map", "pixels"]
    names = table["logs"].unique().tolist()
    mean, *of_logs = (table[table["logs"] == log].set_index(key).sort_index() for log in names)
    assert mean["auroc"].to_numpy() == pytest.approx(np.mean([rows["auroc"] for rows in of_logs], axis=0), abs=1e-4)
    for name in ("hits", "passed"):
        counts = mean[name].unstack()
        assert (counts["seen"] + counts["unseen"] == counts["all"]).all()
    assert mean.loc[("own pixel", f"{weights}, adapted", "seen"), "auroc"] > 0.95
    path, windows = logs[0], list(real_logs.cases_of(logs[0], networks[logs[0]]))
    free = np.concatenate([case.map_of(networks[path]).ravel()[case.pixels] for case in windows])
    truth = np.concatenate([case.free for case in windows])
    row = table[(table["logs"] == path.name) & (table["map"] == f"{weights}, adapted") & (table["pixels"] == "all")]
    assert row["log_loss"].iloc[0] == pytest.approx(log_loss(truth, free.clip(1 / 510, 509 / 510)), abs=2e-3)
    assert (tmp_path / "windows.png").is_file()
    provenance = json.loads((tmp_path / "provenance.json").read_text())
    assert list(provenance["logs"]) == ["dense.log.gz", "sparse.log.gz"]
    assert provenance["commit"]


def test_faults_of_logs_are_counted(logs, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["spoiled", str(logs[0]), "--target", str(tmp_path)])
    spoiled.main()
    rows = pd.read_csv(tmp_path / "spoiled.csv").set_index("fault")
    assert (rows["logs"] == 2).all(), "with all beams and with 90 degrees"
    assert rows.loc["none", "found"] == 0
    assert (rows.loc[["lidar turned by 180 degrees", "x and y exchanged", "constant readings"], "found"] == 2).all()
    assert list(json.loads((tmp_path / "spoiled.json").read_text())["logs"]) == [logs[0].name]
    monkeypatch.setattr("sys.argv", ["spoiled", "people.bag"])
    with pytest.raises(InputError, match=r"expected logs of driving robots, got people\.bag"):
        spoiled.main()
