"""What moves is found among the hits of a window, and what stands is not, whatever the errors of the poses."""

import math

import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.prediction.moving import PARTS, moving_pixels, parts_of_window, stands
from repro.scans import Scans

GRID = Grid(128, 25.0)
ANGLES = np.linspace(-math.pi / 4, math.pi / 4, 91)
STEPS, STEP_S, RANGE_M, RADIUS_M = 100, 0.1, 30.0, 0.25


def corridor(person_m, speed_m_s: float = 0.8, pose_m: float = 0.0) -> Scans:
    """Return a window of a robot in a corridor of 2.4 m, with a person at x, y [m] of each time [s], or without."""
    rng = np.random.default_rng(0)
    times = STEP_S * np.arange(STEPS)
    poses = np.stack([2 + speed_m_s * times, np.full(STEPS, 12.5), np.zeros(STEPS)], axis=1)
    along, across = np.cos(ANGLES), np.sin(ANGLES)
    ranges = np.tile(1.2 / np.abs(across + 1e-9), (STEPS, 1))
    for step, time in enumerate(times if person_m else []):
        dx, dy = np.add(person_m(time), (2, 12.5)) - poses[step, :2]
        middle = dx * along + dy * across
        inside = middle**2 - dx**2 - dy**2 + RADIUS_M**2
        distance = np.where((inside > 0) & (middle > 0), middle - np.sqrt(inside.clip(0)), np.inf)
        ranges[step] = np.minimum(ranges[step], distance)
    ranges = np.where(ranges < RANGE_M, ranges + rng.normal(0, 0.02, ranges.shape), np.inf)
    return Scans(ranges, ANGLES, poses + rng.normal(0, 1, poses.shape) * (pose_m, pose_m, 0))


def moving(window: Scans) -> np.ndarray:
    return moving_pixels(*parts_of_window(window, GRID, RANGE_M), is_still=stands(window.poses))


@pytest.mark.parametrize("speed_m_s", [0.0, 0.8])
def test_a_person_who_walks_by_is_found_where_he_was_hit(speed_m_s):
    found = moving(corridor(lambda time: (12 - 0.9 * time, 0.6), speed_m_s))
    x, y = GRID.centers().reshape(128, 128, 2)[found].T
    assert len(x) > 10
    assert ((y > 12.7) & (y < 13.5)).all()  # not the walls
    assert x.max() - x.min() > 2


@pytest.mark.parametrize("pose_m", [0.0, 0.05])
@pytest.mark.parametrize("person_m", [None, lambda time: (9, 0.6)], ids=["nobody", "who stands"])
def test_nothing_moves_in_a_corridor_of_nobody_or_of_a_person_who_stands(person_m, pose_m):
    assert not moving(corridor(person_m, pose_m=pose_m)).any()


def test_a_person_who_is_seen_in_two_scans_is_too_little():
    seen = corridor(lambda time: (8 - 0.9 * time, 0.6) if time < 0.15 else (-50, 0.6))
    assert not moving(seen).any()


def test_a_scan_that_stands_for_several_steps_counts_once():
    window = corridor(lambda time: (12 - 0.9 * time, 0.6))
    window.ranges[:, 3] = np.nan
    index = np.repeat(np.arange(0, STEPS, 10), 10)
    repeated = Scans(window.ranges[index], ANGLES, window.poses[index])
    once = Scans(window.ranges[::10], ANGLES, window.poses[::10])
    assert len(parts_of_window(window, GRID, RANGE_M)[0]) == PARTS
    for ours, others in zip(*(parts_of_window(window, GRID, RANGE_M) for window in (repeated, once)), strict=True):
        assert len(ours) == STEPS / 10
        assert np.array_equal(ours, others)
