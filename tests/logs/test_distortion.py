"""Beams placed at their own times, against a lidar that is simulated beam by beam."""

import math

import numpy as np
import pytest
from messages import Ros

from repro.logs.messages import LaserScans
from repro.logs.transforms import Transforms

ROS, BEAMS, SCAN_S, HALF_M = Ros(2), 360, 0.18, 5.0
ANGLES = np.radians(np.arange(-180, 180.0))


def pose_at(stamp: float, turn: float, speed: float) -> tuple[float, float, float]:
    return speed * stamp, 0.5 * speed * stamp, turn * stamp


def range_of(x: float, y: float, direction: float) -> float:
    """Return the distance to the walls of a square room."""
    c, s = math.cos(direction), math.sin(direction)
    ends = [(math.copysign(HALF_M, step) - place) / step for place, step in ((x, c), (y, s)) if abs(step) > 1e-9]
    return min(ends)


def scan_of(stamp: float, turn: float, speed: float, increment: float) -> np.ndarray:
    """Return the ranges of a scan, whose beams are measured one after the other."""
    found = []
    for number, angle in enumerate(ANGLES):
        x, y, heading = pose_at(stamp + number * increment, turn, speed)
        found.append(range_of(x, y, heading + angle))
    return np.array(found, np.float32)


def converted(turn: float, speed: float, ranges: np.ndarray, limit: float = 12.0):
    transforms, scans = Transforms(), LaserScans(pytest.fail)
    for stamp in np.arange(-0.5, 1.5, 0.02):
        message = ROS.transform(100 + stamp, "odom", "laser", pose_at(stamp, turn, speed))
        moved = message.transforms[0].transform
        place, quaternion = moved.translation, moved.rotation
        parts = quaternion.x, quaternion.y, quaternion.z, quaternion.w
        transforms.add("laser", "odom", 100 + stamp, (place.x, place.y, 0.0), parts)
    options = {"time_increment": SCAN_S / (BEAMS - 1), "scan_time": SCAN_S, "range_max": limit}
    scan = ROS.scan(100.0, ANGLES, ranges, **options)
    return scans.convert(scan, scans.times(scan), transforms)


@pytest.mark.parametrize(("turn", "speed"), [(1.0, 0.0), (-1.5, 0.3), (0.0, 1.0)])
def test_the_scan_of_a_lidar_that_moves_is_that_of_its_middle(turn, speed):
    raw = scan_of(0.0, turn, speed, SCAN_S / (BEAMS - 1))
    still = np.array([range_of(*pose_at(SCAN_S / 2, turn, speed)[:2], turn * SCAN_S / 2 + angle) for angle in ANGLES])
    scan = converted(turn, speed, raw)
    assert scan.pose == pytest.approx(pose_at(SCAN_S / 2, turn, speed), abs=1e-3)
    known = np.isfinite(scan.ranges)
    assert known.mean() > 0.95, "but for the seam"
    error, before = (np.abs(values[known] - still[known]) for values in (scan.ranges, raw))
    assert np.median(error) < 0.02
    assert np.percentile(error, 95) < 0.5 * np.percentile(before, 95)


def test_misses_stay_misses_and_a_lidar_that_stands_is_left_as_it_is():
    raw = scan_of(0.0, 0.0, 0.0, 0.0)
    raw[100:120], raw[200] = 12.0, np.nan
    assert np.array_equal(converted(0.0, 0.0, raw).ranges, raw, equal_nan=True)
    turned = converted(1.0, 0.5, raw).ranges
    assert 18 <= (turned >= 12.0).sum() <= 22
