import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from conftest import prepared
from shapely import affinity

from repro.baselines import registry, tracker
from repro.baselines.occupancy_grids import log_odds_grid, observation, transitional_grid
from repro.baselines.registry import PREDICTORS, climb, dilate, steps_since_free, tune
from repro.baselines.titles import BASELINES
from repro.evaluation.scoring import evaluate
from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.metrics.counts import counts_of, pooled_scores
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import Recorded, load_recorded
from repro.scans import Scans

GRID = Grid(50, 50.0)
ANGLES = np.linspace(-0.2, 0.2, 41)


def one_recording(ranges, poses=None):
    """Return a recording (1, T, N) of a robot at (5, 25) that looks along x, or with other poses (T, 3)."""
    ranges = np.asarray(ranges)
    if poses is None:
        poses = np.tile([5.0, 25.0, 0.0], (len(ranges), 1))
    return Recorded(Scans(ranges, ANGLES, poses).batched(), np.ones((1, 1, 50, 50)), GRID, 30.0, 0.1)


def disc_ranges(x, y=25.0, radius=2.0):
    """Ranges of the beams from (5, 25) to a disc."""
    along = (x - 5) * np.cos(ANGLES) + (y - 25) * np.sin(ANGLES)
    gap = (x - 5) ** 2 + (y - 25) ** 2 - along**2
    return np.where(gap < radius**2, along - np.sqrt((radius**2 - gap).clip(0)), np.inf)


@pytest.mark.parametrize("name", PREDICTORS)
def test_baselines_predict_every_pixel_of_the_test_set(name, recorded, monkeypatch):
    few = {name: values[2:3] for name, values in registry.TRACKER.items()}
    monkeypatch.setattr(registry, "TRACKER", few | {"margin_m": registry.TRACKER["margin_m"]})
    val, test = (load_recorded(open_recordings(recorded), split, Grid(32, 50.0)) for split in ("val", "test"))
    free, tuned = PREDICTORS[name](val, test)
    assert free.shape == test.maps.shape
    assert 0 <= free.min() <= free.max() <= 1
    assert bool(tuned) == (name not in ("all_free", "mean_map"))
    if tuned:
        assert pooled_scores(counts_of(free, test.maps).sum(0))["obstacle_iou"] > 0.15


def test_last_seen_takes_its_radius_from_the_validation_set(recorded, tmp_path):
    run = prepared(tmp_path, model="last_seen")
    assert 0.1 < evaluate(run, recorded)["obstacle_iou"] < 1
    val = load_recorded(open_recordings(recorded), "val", Grid(32, 50.0))
    hits, since = newest_hits(val.scans, val.grid) > 0, steps_since_free(val)
    tried = {
        (radius, steps): np.where(since < steps, 1.0, dilate(hits, radius))
        for radius, steps in itertools.product(range(4), range(0, 101, 10))
    }
    iou = {chosen: pooled_scores(counts_of(free, val.maps).sum(0))["obstacle_iou"] for chosen, free in tried.items()}
    assert tuple(run.provenance().fact(name) for name in ("radius_px", "free_steps")) == max(iou, key=iou.get)


def test_space_that_a_beam_passed_over_is_free_for_some_steps_unless_it_was_hit_later():
    wall = disc_ranges(15.0)
    recorded = one_recording(np.stack([wall] * 3 + [np.full_like(wall, np.inf)] * 5 + [wall]))
    since = steps_since_free(recorded)[0, 0]
    at_wall, before, behind, out_of_view = since[24, 13], since[24, 9], since[24, 15], since[24, 2]
    assert (before, behind) == (0, 1)
    assert at_wall == out_of_view == 9


def test_a_pixel_in_which_a_beam_ends_is_not_passed_also_where_another_beam_passes_it():
    recorded = one_recording(np.where(np.arange(41) % 2, 10.0, np.inf)[None])  # ten beams in a pixel
    hit, passed = observation(recorded.scans, GRID, 30.0)
    assert hit.any()
    assert passed.any()
    assert not (hit & passed).any()


def test_dilation_draws_discs():
    occupied = np.zeros((1, 9, 9))
    occupied[0, 4, 4] = 0.7
    assert (dilate(occupied, 0) < 1).sum() == 1
    disc = dilate(occupied, 2)[0, 0]
    assert (disc < 1).sum() == 13
    assert disc.min().item() == pytest.approx(0.3)
    assert np.array_equal(disc, disc.T)
    assert np.argwhere(disc < 1).mean(0).tolist() == [4, 4]


def test_the_radius_of_a_grid_is_in_meters():
    fine = replace(one_recording(disc_ranges(15.0)[None]), grid=Grid(100, 50.0))
    occupied = np.zeros((1, 100, 100))
    occupied[0, 40, 60] = 0.7
    predict = registry._dilated(lambda *_: occupied, "forgetting", fine)
    assert np.array_equal(predict(radius_m=2.0, forgetting=0.0), dilate(occupied, 4))


def test_space_stays_free_for_as_long_as_is_best_on_the_validation_set():
    wall = disc_ranges(15.0)
    recorded = one_recording(np.stack([np.full_like(wall, np.inf)] * 3 + [wall] * 7))
    since = steps_since_free(recorded)
    assert set(np.unique(since)) == {0, 7, 10}  # before the wall, behind it, and out of view
    val = replace(recorded, maps=(since < 7).astype(np.float32))
    free, _ = tune(lambda _: lambda x: np.zeros(val.maps.shape, np.float32), {"x": (0.0,)}, val, val)
    assert np.array_equal(free, val.maps)


@pytest.mark.parametrize("filtered", [log_odds_grid, transitional_grid])
def test_a_grid_remembers_recent_observations_and_forgets_old_ones(filtered):
    seen = disc_ranges(15.0)
    recorded = one_recording(np.stack([seen] * 20))
    wall, before = (24, 13), (24, 9)  # where the middle beam ends, and on its way; row 24 is just above y = 25
    still = filtered(recorded, 0.0)[0]
    assert still[wall] > 0.9
    assert still[before] < 0.01
    turned = np.array([[5.0, 25.0, 0.0]] * 2 + [[5.0, 25.0, 3.0]] * 40)
    away = one_recording(np.concatenate([np.stack([seen] * 2), np.full((40, 41), np.inf)]), turned)
    kept, faded = (filtered(away, rate)[0][wall] for rate in (0.0, 0.2))
    assert kept > 0.9
    assert faded < kept - 0.2


def test_log_odds_are_forgotten_and_added_in_every_step():
    seen, none = disc_ranges(15.0), np.full((41,), np.nan)
    prior = math.log(0.08 / 0.92)
    gain = math.log(0.9 / 0.1) - prior
    for ranges, expected in [([seen, *[none] * 4], gain * 0.9**4), ([seen, *[none] * 5, seen], gain * (1 + 0.9**6))]:
        found = log_odds_grid(one_recording(np.stack(ranges)), 0.1)[0][24, 13]
        assert found == pytest.approx(1 / (1 + math.exp(-expected - prior)), rel=1e-5)
    many = log_odds_grid(one_recording(np.stack([seen] * 9)), 0.0)[0][24, 13]
    assert many == pytest.approx(1 / (1 + math.exp(-8 - prior)), rel=1e-5)


def test_a_transitional_grid_agrees_with_plain_sums_over_neighbors():
    recorded = one_recording(np.stack([disc_ranges(15.0 + step, 26.0) for step in range(5)]))
    static = dynamic = np.full((50, 50), 0.04)
    for step in range(5):
        one = Scans(recorded.scans.ranges[:, step : step + 1], ANGLES, recorded.scans.poses[:, :1])
        hit, passed = (seen[0] for seen in observation(one, GRID, 30.0))
        wide = np.pad(dynamic, 1, mode="edge")
        around = sum(wide[i : i + 50, j : j + 50] for i, j in itertools.product(range(3), repeat=2)) - dynamic
        dynamic = 0.7 * dynamic + 0.3 * around / 8
        static = static + 0.01 * dynamic
        dynamic = np.minimum(0.99 * dynamic, 1 - static)
        odds = np.select([hit, passed], [9 * 0.92 / 0.08, 0.05 / 0.95 * 0.92 / 0.08], 1.0)
        total = 1 - static - dynamic + odds * (static + dynamic)
        static, dynamic = ((odds * part / total).clip(1e-4, 0.999) for part in (static, dynamic))
    expected = np.minimum(static + dynamic, 1)
    assert transitional_grid(recorded, 0.3)[0] == pytest.approx(expected, rel=1e-4)
    assert np.ptp(expected) > 0.9


PRIOR = tracker.Prior(radius_m=2.0, spread_m=0.5, aspect=1.4, speed_m_s=1.0, join=5.0)


def window(ranges):
    """Return ranges (T, N) as scans of a robot at (5, 25) that looks along x."""
    poses = np.tile([5.0, 25.0, 0.0], (len(ranges), 1))
    return Scans(np.stack([np.asarray(scan, dtype=float) for scan in ranges]), ANGLES, poses)


def test_hits_are_clustered_in_space_and_time():
    both = np.minimum(disc_ranges(15.0, 27.0, 1.0), disc_ranges(15.0, 23.0, 1.0))
    none = np.full_like(both, np.inf)
    found = tracker.clusters(window([both] * 21 + [none] * 60 + [both] * 21), 0.1, 1.5)
    assert len(found) == 4
    assert sorted({round(float(cluster.hits[:, 2].min()), 1) for cluster in found}) == [-10.0, -2.0]  # [s]
    assert tracker.clusters(window([none] * 21), 0.1, 1.5) == []


@pytest.mark.parametrize(("y", "edges"), [(25.0, 22), (27.5, 11)])
def test_edges_are_where_the_next_beam_passes(y, edges):
    """A disc that the field of view cuts has one edge in each scan."""
    (found,) = tracker.clusters(window([disc_ranges(15.0, y, 1.5)] * 21), 0.1, 1.5)
    assert len(found.edges) == edges
    x, y_robot, _, cos, sin, side = found.edges.T
    aside = side * (cos * (y - y_robot) - sin * (15.0 - x))
    assert np.allclose(aside, 1.5, atol=0.06)  # the beams are 0.1 m apart


@pytest.mark.parametrize(("behind_m", "edges"), [(0.4, 0), (0.6, 2)])
def test_a_beam_passes_an_obstacle_if_it_ends_half_a_meter_behind(behind_m, edges):
    near = np.abs(np.arange(41) - 20) < 8
    scans = window([np.where(near, 10.0, 10.0 + behind_m)])
    steps, beams = np.zeros(15, int), np.flatnonzero(near)
    assert len(tracker._edges(scans, steps, beams, np.zeros(15))) == edges


def test_a_moving_disc_is_fitted_and_coasts():
    steps = 60  # at 1 m/s: from x = 15 to 21, seen for the first 40 steps
    ranges = [disc_ranges(15 + 0.1 * step) if step < 40 else np.full((41,), np.inf) for step in range(steps)]
    (found,) = tracker.track(tracker.clusters(window(ranges), 0.1, 1.5), PRIOR)
    assert found.is_disc
    assert found.state[:5] == pytest.approx([20.9, 25, 1, 0, 2], abs=0.15)
    nearest = tracker.distances([found], GRID, 99.0)
    assert (nearest <= 0).sum() == pytest.approx(4 * np.pi, abs=2)
    assert nearest[24, 20] == pytest.approx(np.hypot(0.4, 0.5) - 2, abs=0.2)  # its center is (20.5, 25.5)
    coasted = tracker.distances([found], GRID, 1.0)  # for one second, not for two
    assert coasted[24, 19] == pytest.approx(np.hypot(0.4, 0.5) - 2, abs=0.2)


def moving_disc(x: float, speed_m_s: float, age_s: float = 0.0) -> tracker.Track:
    return tracker.Track(np.array([x, 25.0, speed_m_s, 0.0, 2.0, 0.0, 0.0]), True, 0.0, age_s)


@pytest.mark.parametrize(("ahead_s", "x"), [(0.0, 20.0), (0.5, 20.5), (3.0, 21.0)])
def test_a_track_moves_ahead_until_it_has_coasted(ahead_s, x):
    found = tracker.distances([moving_disc(20.0, 1.0, age_s=1.0)], GRID, 2.0, ahead_s)
    assert np.array_equal(found, tracker.distances([moving_disc(x, 0.0)], GRID, 2.0))


@pytest.mark.parametrize(("x", "is_near"), [(20.0, False), (15.0, False), (10.0, True)])
def test_tracks_are_near_if_they_meet_halfway_between_their_hits(x, is_near):
    """The first one, at 20 m now, was at 10 m ten seconds ago."""
    early, late = (tracker.Cluster(np.array([[0.0, 0.0, time, 1.0, 0.0]]), np.zeros((0, 6))) for time in (-12.0, -8.0))
    assert tracker._is_near(early, moving_disc(20.0, 1.0), late, moving_disc(x, 0.0)) == is_near


def rectangle_ranges(x, length, width, heading):
    """Ranges of the beams from (5, 25) to a rectangle at (x, 25)."""
    rays = shapely.linestrings([[(5, 25), (5 + 40 * np.cos(a), 25 + 40 * np.sin(a))] for a in ANGLES])
    shape = affinity.rotate(shapely.box(x - length / 2, 25 - width / 2, x + length / 2, 25 + width / 2), heading)
    distance = shapely.distance(shapely.Point(5, 25), shapely.intersection(rays, shape))
    return np.where(np.isfinite(distance), distance, np.inf)


def test_a_rectangle_is_told_from_a_disc():
    (found,) = tracker.track(tracker.clusters(window([rectangle_ranges(16, 3.5, 2.5, 30)] * 21), 0.1, 1.5), PRIOR)
    assert not found.is_disc
    assert found.state[:2] == pytest.approx([16, 25], abs=0.5)
    assert np.pi * found.state[4] ** 2 == pytest.approx(3.5 * 2.5, rel=0.3)
    assert np.degrees(found.state[6]) % 90 == pytest.approx(30, abs=5)


def test_an_obstacle_that_is_seen_twice_is_joined():
    seen, none = disc_ranges(15.0), np.full((41,), np.inf)
    scans = window([seen] * 21 + [none] * 60 + [seen] * 21)
    assert len(tracker.clusters(scans, 0.1, 1.5)) == 2
    (found,) = tracker.track(tracker.clusters(scans, 0.1, 1.5), PRIOR)
    assert found.age_s == 0
    assert len(tracker.track(tracker.clusters(scans, 0.1, 1.5), replace(PRIOR, join=-1e3))) == 2
    apart = [disc_ranges(15.0)] * 21 + [none] * 60 + [disc_ranges(18.5, radius=1.0)] * 21
    assert len(tracker.track(tracker.clusters(window(apart), 0.1, 1.5), replace(PRIOR, speed_m_s=0.05))) == 2


def test_climbing_stops_where_no_step_improves():
    place = climb(lambda values: -4 * (values[0] - 7) ** 2 - (values[1] - values[0]) ** 2, [range(10), range(10)])
    assert place == (7, 7)


def test_every_baseline_has_a_title_and_a_predictor():
    assert set(PREDICTORS) == set(BASELINES) - {"privileged", "inference"}  # published rows only
