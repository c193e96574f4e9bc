import math

import numpy as np

from repro.maps.grid import Grid
from repro.prediction.agreement import agreement, last_hits, observed
from repro.scans import Scans

GRID = Grid(100, 50.0)
ANGLES = np.linspace(-0.5, 0.5, 101)
POSE = np.array([[25.0, 25.0, 0.0]])


def wall(distance_m: float) -> Scans:
    """Return a scan of a wall across the x axis, from the center of the map."""
    return Scans(distance_m / np.cos(ANGLES)[None], ANGLES, POSE)


def right_of(x_m: float) -> np.ndarray:
    """Return a map with an obstacle right of x."""
    return np.where(GRID.centers().reshape(100, 100, 2)[..., 0] > x_m, 0.0, 1.0)


def shares(free: np.ndarray, scan: Scans) -> tuple[float, float]:
    return agreement(free, observed(scan, GRID, 30.0))


def test_agreement_counts_hits_on_obstacles_and_passed_pixels():
    free = right_of(30)
    assert shares(free, wall(5)) == (1.0, 1.0)
    assert shares(free, wall(2.5)) == (0.0, 1.0)
    hits, passed = shares(free, wall(15))
    assert hits == 1.0
    assert 0.1 < passed < 0.5
    misses = Scans(np.full((1, 101), np.inf), ANGLES, POSE)
    assert math.isnan(shares(free, misses)[0])


def test_invalid_readings_are_not_compared():
    scan = wall(5)
    scan.ranges[0, :50] = np.nan
    half, whole = (observed(each, GRID, 30.0) for each in (scan, wall(5)))
    assert 0 < half.hits.sum() < whole.hits.sum()
    assert 0 < half.passed.sum() < 0.6 * whole.passed.sum()


def test_a_scan_may_be_compared_on_some_pixels_only():
    left = np.zeros((100, 100), dtype=bool)
    left[:, :55] = True
    scan = observed(wall(5), GRID, 30.0).within(left)
    assert scan.hits.sum() == 0
    assert scan.passed[:, :55].sum() == scan.passed.sum() > 0


def test_the_newest_beam_decides_in_the_map_of_the_last_hits():
    near, far = (wall(distance).ranges for distance in (5.25, 10.25))
    hit_column, steps = 60, {"then free": [near, far], "then hit": [far, near]}
    for name, ranges in steps.items():
        scans = Scans(np.concatenate(ranges), ANGLES, np.repeat(POSE, 2, axis=0))
        free, seen = last_hits(scans, GRID, 30.0)
        assert free[50, hit_column] == (name == "then free")
        assert seen[50, 52:70].all()
        assert not seen[:, :49].any()
