"""reproduce/movers: regions, bins, clouds, and the measures of maps whose answer is known."""

import dataclasses

import numpy as np
import pytest
from reproduce.movers import __main__ as script
from reproduce.movers import bags, corridor, measures, tuning
from reproduce.movers.cloud import Clouds, CloudSettings, cloud_map, new_scans, passes
from reproduce.movers.rates import GROUPS, KINDS, Rates, Sample, TrackSettings, kinds, parse, plain
from reproduce.movers.scenes import BINS, PLACES, Place, bin_of, scenes, targets, touches, within

from repro.learning.rehearsal import true_map
from repro.maps.grid import Grid
from repro.networks.predictor import load_predictor
from repro.scans import Scans
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate

GRID = Grid(128, 25.0)
CROSSING = Place("rooms", "crossing")


@pytest.fixture(scope="module")
def crowd():
    """Record three open places with people."""
    return list(scenes(CROSSING, range(3), GRID.size_m))


def test_the_bins_have_the_scans_that_their_names_say():
    for since in range(100):
        first, _, last = BINS[bin_of(since)].partition("-")
        assert int(first) <= since <= int(last or first)


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.name)
def test_no_pixel_is_in_two_regions_and_movers_are_in_theirs_or_in_one_that_was_hit_later(place):
    grid = Grid(128, place.spec.world.width)
    scene = next(scene for scene in scenes(place, range(20), grid.size_m) if scene.movers)
    asked = targets(scene, grid)
    assert np.sum([target.region for target in asked], axis=0).max() == 1
    for number, target in enumerate(asked):
        reached = np.any([before.region for before in asked[: number + 1]], axis=0)
        elsewhere = target.body & ~reached
        if scene.without_movers is None:
            assert not elsewhere.any(), "it was faster than its world allows"
        assert not (target.taken & ~target.region).any()


def test_what_stands_and_what_walls_hide_is_in_no_region():
    scene = next(scene for scene in scenes(Place("rooms", "people"), range(20), GRID.size_m) if scene.movers)
    stands = true_map(scene.recording, np.array(scene.window.origin), GRID, ~scene.moves) == 0
    asked = targets(scene, GRID)
    region = np.any([target.region for target in asked], axis=0)
    assert region.any()
    assert not (region & stands).any()
    hidden = targets(dataclasses.replace(scene, without_movers=None), GRID)
    assert region.sum() < np.any([target.region for target in hidden], axis=0).sum()


def test_hits_belong_to_the_movers_that_the_ray_casting_hit():
    spec = CROSSING.spec.with_lidar(noise=False, std=None)
    recording = simulate(sample_world(spec, 1))
    movers = np.arange(len(recording.seen))
    found = touches(recording, movers, 0.02)
    np.testing.assert_array_equal(found.any((1, 2)), recording.seen)
    np.testing.assert_array_equal(found.any(0), np.isfinite(recording.scans.ranges))


def test_the_true_map_holds_all_and_a_free_map_nothing(crowd):
    maps = {name: [] for name in (measures.CONSTANT, "true", "free")}
    for number, scene in enumerate(crowd):
        asked = targets(scene, GRID)
        truth = np.any([target.taken | target.body for target in asked], axis=0).astype(float)
        for target in asked:
            for name, obstacle in ((measures.CONSTANT, 0.5 + 0 * truth), ("true", truth), ("free", 0 * truth)):
                maps[name].append(measures.held(number, target, obstacle))
    rows = list(measures.rows(maps, (measures.CONSTANT,)))
    true, free = ([row for row in rows if row["map"] == name] for name in ("true", "free"))
    assert {row["since"] for row in true} > {"0", "41-99"}
    for row in true:
        assert row["held"] == row["held_low"] == pytest.approx(1)
        assert row["drawn"] == row["peak"] == 1
        assert row["log_loss"] == pytest.approx(-np.log(1 - measures.SMALLEST))
        assert row["less_constant"] == pytest.approx(row["log_loss"] - np.log(2))
    for row in free:
        assert row["held"] == row["drawn"] == row["peak"] == 0


def test_medians_count_values_as_often_as_they_are_drawn():
    rng = np.random.default_rng(0)
    values, weights = rng.random(7), rng.integers(0, 4, (20, 7))
    weights[0] = 0
    expected = [np.quantile(np.repeat(values, own), 0.5, method="inverted_cdf") for own in weights[1:]]
    found = measures._medians(values, weights)
    np.testing.assert_array_equal(found[1:], expected)
    assert np.isnan(found[0])


def test_first_and_last_pass_of_a_pixel():
    angles = np.linspace(-0.2, 0.2, 41)
    ranges = np.full((5, 41), 3.0)
    ranges[1:4] = 10.0
    scans = Scans(ranges, angles, np.tile([12.5, 12.5, 0.0], (5, 1)))
    first, last = passes(scans, GRID, 30.0)
    near, far = (tuple(np.argwhere(within(GRID, np.array([x, 12.5]), 0.15))[0]) for x in (14.0, 17.0))
    assert (first[near], last[near]) == (1, 5)
    assert (first[far], last[far]) == (2, 4)
    assert (first[0, 0], last[0, 0]) == (6, 0)


def test_a_scan_that_stands_for_several_steps_counts_once():
    ranges = np.array([[1.0], [1.0], [1.0], [2.0], [np.nan], [np.nan], [3.0], [3.0]])
    scans = Scans(ranges, np.zeros(1), np.zeros((8, 3)))
    assert np.flatnonzero(new_scans(scans)).tolist() == [1, 3, 4, 7]


@pytest.fixture(scope="module")
def passer():
    """Return the scans of a person who walks by a robot in a corridor."""
    return corridor.walk(corridor.WALK_M_S)


def _middle(cloud):
    x = GRID.resolution_m * (np.arange(128) + 0.5)
    return np.array([(cloud.sum(0) * x).sum(), (cloud.sum(1) * x[::-1]).sum()]) / cloud.sum()


def test_a_cloud_walks_on_with_the_person_who_has_left_the_view(passer):
    settings = CloudSettings(turn_s=1000.0, survival_s=1000.0, passed_share=0.3)
    for after_s in (0.0, 1.0):
        scans, place = passer.window(after_s, GRID.size_m)
        cloud = cloud_map(scans, GRID, settings, 0.1, 30.0) * within(GRID, place, 1.2)
        assert np.linalg.norm(_middle(cloud) - place) < 0.4
        assert cloud.sum() * GRID.resolution_m**2 == pytest.approx(np.pi * settings.radius_m**2, rel=0.35)


def test_a_cloud_spreads_with_time_and_fades_with_its_survival(passer):
    def cloud(after_s, **settings):
        return cloud_map(passer.window(after_s, GRID.size_m)[0], GRID, CloudSettings(**settings), 0.1, 30.0)

    assert cloud(0.0).max() > 0.8 > 0.5 > cloud(3.0).max() > 0
    assert cloud(3.0, survival_s=1.0).sum() < 0.3 * cloud(3.0, survival_s=100.0).sum()


def test_a_cloud_that_beams_pass_over_vanishes_and_one_behind_an_end_does_not():
    angles, pose = np.linspace(-0.5, 0.5, 51), np.array([12.5, 12.5, 0.0])
    for reading, stays in ((10.0, False), (np.inf, False), (2.0, True), (np.nan, True)):
        clouds = Clouds(CloudSettings(), 0.1, GRID, np.zeros(0, int))
        clouds.take(np.array([[15.5, 12.5]]))
        for _ in range(3):
            clouds.see(np.full(51, reading), angles, pose)
        assert (clouds.draw().max() > 0.5) == stays


def test_two_clouds_keep_their_own_clusters():
    clouds = Clouds(CloudSettings(), 0.1, GRID, np.zeros(0, int))
    places = np.array([[5.0, 5.0], [8.0, 5.0]])
    for step in range(8):
        clouds.predict()
        clouds.take(places + step * np.array([[0.1, 0.0], [-0.1, 0.0]]))
    assert len(clouds.exists) == 2
    np.testing.assert_allclose(clouds.velocity.mean(1)[:, 0], [1.0, -1.0], atol=0.25)


def test_rates_are_shares_of_the_pixels():
    rng = np.random.default_rng(0)
    group, kind = rng.integers(0, 2, 40_000), rng.integers(0, 2, 40_000)
    odds = np.exp(-2 + 2 * group + kind)
    taken = rng.random(40_000) < odds / (1 + odds)
    rates = Rates.fit([Sample(group, kind, taken)])
    assert rates.table.shape == (GROUPS, KINDS)
    np.testing.assert_allclose(rates.table[:2, :2], [[0.119, 0.269], [0.5, 0.731]], atol=0.02)
    assert rates.of(np.array([1]), np.array([0]))[0] == rates.table[1, 0]


def test_kinds_tell_hits_passes_and_what_was_never_seen_by_their_time(crowd):
    scans = crowd[0].window.scans
    kind = kinds(scans, GRID, 30.0)
    points, hit = scans.points()
    row, column = 127 - np.floor(points / GRID.resolution_m)[-1][hit[-1]].astype(int).T[1], None
    column = np.floor(points / GRID.resolution_m)[-1][hit[-1]].astype(int).T[0]
    inside = (row >= 0) & (row < 128) & (column >= 0) & (column < 128)
    assert (kind[row[inside], column[inside]] == 0).all()
    assert set(np.unique(kind)) <= set(range(KINDS))
    assert (kind == KINDS - 1).any()


@pytest.mark.parametrize("follower", [CloudSettings(radius_m=0.3), TrackSettings.of_study("3")])
def test_what_was_tuned_is_read_as_it_was_written(follower):
    assert parse(plain(follower)) == follower
    tuned = tuning.Tuned(follower, *(Rates(np.full((GROUPS, KINDS), 0.25)),) * 2, np.full(len(BINS), 0.5))
    again = tuning.Tuned.parse(tuned.plain())
    assert again.follower == follower
    np.testing.assert_array_equal(again.tracked.table, tuned.tracked.table)


def test_places_near_the_last_hits_of_what_moves_have_the_scans_since():
    angles = np.linspace(-1.0, 1.0, 5)
    ranges = np.full((30, 5), 6.0)
    ranges[9, 2] = 3.0  # 20 scans before the end
    scans = Scans(ranges, angles, np.zeros((30, 3)))
    usual = np.linspace(-2.0, 2.0, 9), np.full(9, 6.0)
    moving = bags.moving_hits(scans, usual)
    assert np.argwhere(moving).tolist() == [[9, 2]]
    reach = bags.RADIUS_M + 0.2 + 20 * 0.1 * bags.TOP_M_S
    centers = np.array([[3.0, 0.0], [3.0, reach - 0.01], [3.0, reach + 0.01]])
    assert bags.since_hits(scans, moving, centers, 0.1).tolist() == [20, 20, -1]


def test_the_person_in_the_corridor_is_hit_last_at_time_zero(passer):
    scans, place = passer.window(0.0, 25.0)
    ends = scans.points()[0][-1]
    assert np.linalg.norm(ends - place, axis=-1).min() < corridor.RADIUS_M + 1e-6
    later, place = passer.window(0.1, 25.0)
    assert np.linalg.norm(later.points()[0][-1] - place, axis=-1).min() > corridor.RADIUS_M + 1e-6
    np.testing.assert_allclose(later.poses[-1, :2], 12.5)


def test_no_training_has_the_worlds():
    from repro.recordings.format import SPLIT_SEEDS, SPLITS

    assert min(script.FIRST_SEED, script.FIRST_TUNED) >= max(SPLITS.values()) + SPLIT_SEEDS
    tested = range(script.FIRST_SEED, script.FIRST_TUNED)
    assert script.FIRST_TUNED not in tested


def test_networks_are_asked_where_their_maps_fit():
    found = script.networks_of(["buildings", "exp3", "again=rooms"], CROSSING)
    assert list(found) == ["buildings", "again"]
    assert list(script.networks_of(["buildings", "exp3"], PLACES[3])) == ["exp3"]


def test_the_delivered_map_is_that_of_the_predictor(crowd):
    network = load_predictor("rooms")
    scans = crowd[0].window.scans
    free = np.asarray(network.predict(scans))[0]
    np.testing.assert_array_equal(script.obstacle_map(network, scans, 30.0), 1 - free)


@pytest.mark.slow
def test_the_command_tunes_and_measures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(script, "TUNED", 3)
    monkeypatch.setattr(script, "SEARCHED", 2)
    monkeypatch.setattr(tuning, "TRIED", {"radius_m": (1.2,)})
    monkeypatch.setattr(script, "PLACES", (CROSSING, *PLACES[3:4]))
    monkeypatch.setattr(script, "OF_CORRIDOR", CROSSING.name)
    for arguments in (["--tune"], ["--weights", "rooms", "exp3", "--recordings", "4"]):
        monkeypatch.setattr("sys.argv", ["movers", "--target", str(tmp_path), *arguments])
        script.main()
    files = {path.name for path in tmp_path.iterdir()}
    assert {
        "tuned.json",
        "rooms_crossing.csv",
        "paper_3.csv",
        "corridor.csv",
        "corridor.png",
        "provenance.json",
    } <= files
    assert "rooms crossing" in capsys.readouterr().out
