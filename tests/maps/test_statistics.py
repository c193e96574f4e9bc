import dataclasses

import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.maps.statistics import LEVELS, TITLES, lower_median, measure, summarize
from repro.scans import Scans

GRID = Grid(10, 10.0)


def windows() -> Scans:
    """Two windows of 4 steps: a robot that stands and turns once, and one that drives 3 m and sees nothing new."""
    ranges = np.full((2, 4, 3), np.inf)
    ranges[0, 0] = 2.0  # three hits at age 3
    ranges[0, 3, 1] = 4.0  # one at age 0
    ranges[1, :, 1] = 3.0  # in another pixel at each step
    poses = np.zeros((2, 4, 3))
    poses[..., :2] = 1.5
    poses[0, :, :2] = 5.5
    poses[0, :, 2] = [0, 3, -3, 3]  # 3, then 0.283 across half a turn and back
    poses[1, :, 0] += np.arange(4)
    return Scans(ranges, np.radians([-45.0, 0.0, 45.0]), poses).batched()


def test_the_statistics_of_two_windows_by_hand():
    values = measure(windows(), GRID)
    assert set(values) == set(TITLES)
    turn = np.degrees(3 + 2 * (2 * np.pi - 6))
    expected = {
        "hit_share": [4 / 12, 4 / 12],
        "occupied_share": [0.04, 0.04],
        "hit_age_steps": [9 / 4, 6 / 4],
        "hit_range_m": [2, 3],
        "path_m": [0, 3],
        "turn_deg": [turn, 0],
        "fov_deg": [90, 90],
        "beams": [3, 3],
    }
    for name, value in expected.items():
        assert values[name] == pytest.approx(value, abs=1e-4), name


def test_the_median_is_the_lower_of_two_in_the_middle():
    values = np.array([[4.0, 1, 3, 2], [np.nan, 5, 1, 3], [np.nan] * 4])
    assert np.array_equal(lower_median(values), [2, 3, np.nan], equal_nan=True)


def test_quantiles_are_those_of_all_windows_with_a_hit():
    random = np.random.default_rng(0)
    ranges = random.uniform(1, 4, (50, 4, 3))
    ranges[random.random(ranges.shape) < 0.3] = np.inf
    ranges[7] = np.inf
    scans = Scans(ranges, np.array([-0.5, 0, 0.5]), np.full((50, 4, 3), 5.0)).batched()
    found = summarize([scans[:20], scans[20:]], GRID)
    share = np.delete(np.isfinite(ranges).mean(axis=(1, 2)), 7)
    assert found.windows == 49
    assert found.quantiles["hit_share"] == pytest.approx(np.quantile(share, LEVELS), rel=1e-5)
    assert found.range_of("hit_share") == pytest.approx((share.min(), share.max()), rel=1e-5)
    assert found.quantiles["hit_share"][2] == pytest.approx(np.median(share), rel=1e-5)
    other = dataclasses.replace(found, windows=1, quantiles={"hit_share": (0.0, 0.1, 0.2, 0.3, 0.4)})
    both = found.widened(other)
    assert (both.windows, both.range_of("hit_share")) == (50, (0.0, found.range_of("hit_share")[1]))
    assert both.quantiles["hit_share"][1:-1] == found.quantiles["hit_share"][1:-1]


def test_windows_outside_the_training_are_named():
    statistics = summarize([windows()], GRID)
    values = {name: float(value[1]) for name, value in measure(windows(), GRID).items()}
    assert statistics.outside(values) == []
    assert statistics.outside(values | {"fov_deg": 90.8, "path_m": 3.02}) == []  # within one percent
    assert statistics.outside(values | {"beams": 300.0}) == []  # they draw nearly the same images
    assert statistics.outside(values | {"beams": 2.0}) == ["beams"]
    changed = values | {"fov_deg": 91.0, "path_m": 3.1, "hit_share": 0.2}
    assert set(statistics.outside(changed)) == {"fov_deg", "path_m", "hit_share"}
    known = dataclasses.replace(statistics, quantiles={"beams": statistics.quantiles["beams"]})
    assert known.outside(values | {"fov_deg": 270.0}) == []


def test_windows_without_hits_have_no_quantiles():
    empty = windows()
    with pytest.raises(ValueError, match="no training window has a hit"):
        summarize([Scans(np.full_like(empty.ranges, np.inf), empty.angles, empty.poses)], GRID)
