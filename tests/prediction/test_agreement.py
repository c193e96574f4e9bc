import math

import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.prediction.agreement import (
    LAST_HIT,
    LAST_PASSED,
    NEVER_SEEN,
    SURE,
    compare_with_scans,
    last_hits,
    log_loss,
    observed,
)
from repro.prediction.windows import Window
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


def loss(free: np.ndarray, scan: Scans) -> float:
    return log_loss(free, observed(scan, GRID, 30.0))


def test_the_log_loss_is_of_the_pixels_themselves():
    """A map that is shifted by one pixel is wrong, and so is one without obstacles, however many pixels are free."""
    shown = observed(wall(5), GRID, 30.0)
    truth = np.where(shown.hits, 0.0, 1.0)
    pixels, hits = shown.hits.sum() + shown.passed.sum(), shown.hits.sum()
    assert loss(truth, wall(5)) == pytest.approx(-math.log(1 - SURE))
    assert loss(np.ones_like(truth), wall(5)) == pytest.approx(-math.log(SURE) * hits / pixels, rel=0.01)
    assert loss(np.roll(truth, 1, axis=1), wall(5)) > loss(np.ones_like(truth), wall(5)) * 0.9
    assert loss(np.full_like(truth, 0.5), wall(5)) == pytest.approx(math.log(2))
    assert loss(right_of(30), wall(15)) > 1
    nothing = Scans(np.full((1, 101), np.nan), ANGLES, POSE)
    assert math.isnan(loss(truth, nothing))


def test_a_map_is_compared_with_one_of_the_last_hits_on_the_next_scan_and_on_held_out_beams():
    window = Window(1, 0.0, wall(5), (0.0, 0.0), wall(5), Scans(wall(5).ranges, ANGLES + math.pi, POSE))
    losses = compare_with_scans(window, np.full((100, 100), 0.5), GRID, 30.0)
    names = ["next_scan_log_loss", "next_scan_last_hits_log_loss", "held_out_log_loss", "held_out_last_hits_log_loss"]
    assert list(losses) == names
    shown = observed(wall(5), GRID, 30.0)
    hits, passed = shown.hits.sum(), shown.passed.sum()
    right = -math.log(LAST_HIT) * hits - math.log(1 - LAST_PASSED) * passed
    assert losses["next_scan_last_hits_log_loss"] == pytest.approx(right / (hits + passed))
    shown = observed(window.held_out, GRID, 30.0)
    never = -math.log(NEVER_SEEN) * shown.hits.sum() - math.log(1 - NEVER_SEEN) * shown.passed.sum()
    assert losses["held_out_last_hits_log_loss"] == pytest.approx(
        never / (shown.hits.sum() + shown.passed.sum()), rel=0.05
    )
    assert losses["held_out_log_loss"] == pytest.approx(math.log(2))
    assert compare_with_scans(Window(1, 0.0, wall(5), (0.0, 0.0), None), np.ones((100, 100)), GRID, 30.0) == {}


def test_invalid_readings_are_not_compared():
    scan = wall(5)
    scan.ranges[0, :50] = np.nan
    half, whole = (observed(one, GRID, 30.0) for one in (scan, wall(5)))
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
