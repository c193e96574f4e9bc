"""LaserScan messages of ROS 1 and ROS 2 become scans, placed by their transforms."""

import math

import numpy as np
import pytest
from messages import Ros
from scipy.spatial.transform import Rotation

from repro.logs.messages import LaserScans, ScanTimes, add_transforms
from repro.logs.transforms import Transforms

ORIGIN, RESOLUTION_M = (-3.0, 7.0), 0.5
ROS = Ros(2)
STANDING = Transforms(pose=(1.0, 2.0, 3.0))


@pytest.mark.parametrize("is_upside_down", [False, True])
def test_the_beams_of_a_lidar_point_where_its_transform_says(is_upside_down):
    """The point that a beam hits is compared with the rotation of its direction in space."""
    own, ranges = -0.5 + 0.5 * np.arange(4), np.array([1, 2, 3, 4], np.float32)
    for heading in np.linspace(-3, 3, 7):
        turn = Rotation.from_euler("z", heading) * Rotation.from_euler("x", math.pi if is_upside_down else 0)
        transforms, scans = Transforms(), LaserScans(pytest.fail)
        rotation = ROS.types["Quaternion"](*turn.as_quat())
        add_transforms(transforms, ROS.transform(5.0, "map", "laser", (1.0, 2.0), rotation))
        message = ROS.scan(5.0, own, ranges)
        scan = scans.convert(message, scans.times(message), transforms)
        angles = scan.pose[2] + scan.first_angle + scan.spacing * np.arange(4)
        found = np.array(scan.pose[:2]) + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = turn.apply(ranges[:, None] * np.stack([np.cos(own), np.sin(own), np.zeros(4)], axis=1))
        assert found == pytest.approx(points[:, :2] + (1, 2))


def laser_scan(stamp: float = 5.0, **changes):
    fields = {"ranges": np.full(101, 2.0), "angle_max": 0.5, "angle_increment": 0.01}
    return ROS.scan(stamp, np.linspace(-0.5, 0.5, 101), **fields | changes)


@pytest.mark.parametrize(("increment", "is_used"), [(0.001, True), (0.1, False), (math.nan, False), (-1.0, False)])
def test_a_time_increment_with_which_scans_overlap_is_ignored_with_a_message(increment, is_used):
    warnings: list[str] = []
    scans = LaserScans(warnings.append)
    for step in range(5):
        stamp, middle, _ = scans.times(laser_scan(5 + 0.1 * step, time_increment=increment))
        assert middle - stamp == pytest.approx(0.05 if is_used else 0, abs=1e-6)
    assert len(warnings) == (not is_used)
    assert is_used or warnings[0].startswith("time_increment is ")


@pytest.mark.parametrize(
    ("changes", "spacing", "problem"),
    [
        ({}, 0.01, None),
        ({"angle_max": 0.51}, 0.01, None),  # the angle after the last beam
        ({"angle_max": math.nan}, 0.01, None),
        ({"angle_increment": 0.0}, 0.0, "with angles that contradict one another"),
        ({"ranges": np.full(95, 2.0, np.float32)}, 1 / 94, None),  # of a lidar whose number of readings varies
        ({"angle_increment": 0.0098}, 0.01, None),  # rounded, so that the last beam is a degree off
        ({"angle_increment": 0.0001}, 0.0001, "with angles that contradict one another"),
        ({"ranges": np.full(51, 2.0, np.float32)}, 0.01, "with angles that contradict one another"),
    ],
)
def test_the_angles_of_a_scan_are_checked_against_one_another(changes, spacing, problem):
    scan = LaserScans(lambda _: None).convert(laser_scan(**changes), ScanTimes(5.0, 5.0, 5.0), STANDING)
    assert (scan.problem, scan.pose) == (problem, (1.0, 2.0, 3.0))
    assert scan.spacing == pytest.approx(spacing)
