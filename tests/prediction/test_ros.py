"""Messages of ROS 1 and ROS 2 from maps, checked by the types of rosbags and by the definition of OccupancyGrid."""

import functools
import math

import numpy as np
import pytest
from messages import Ros
from scipy.spatial.transform import Rotation

from repro.maps.grid import Grid
from repro.prediction.ros import LaserScans, add_transforms, grid_message, occupancy
from repro.prediction.stream import StreamMap
from repro.prediction.transforms import Transforms

ORIGIN, RESOLUTION_M = (-3.0, 7.0), 0.5
ROS = Ros(2)
STANDING = Transforms(pose=(1.0, 2.0, 3.0))


def test_cells_are_row_major_from_the_lower_left_corner():
    """In the words of nav_msgs: row-major order, starting with (0, 0), of which the origin is the pose."""
    free = np.random.default_rng(0).random((40, 40))
    data, grid = occupancy(free, np.zeros((40, 40), bool)), Grid(40, 20.0)
    for x, y in np.random.default_rng(1).uniform(0, 20, (200, 2)):
        nearest = np.linalg.norm(grid.centers() - (x, y), axis=1).argmin()
        cell = data[int(y / RESOLUTION_M) * 40 + int(x / RESOLUTION_M)]
        assert cell == round(100 * (1 - free.ravel()[nearest]))


def test_unknown_is_minus_one_and_the_rest_0_to_100():
    free = np.array([[1.0, 0.0], [0.5, 0.31]])
    unknown = np.array([[True, True], [True, False]])
    assert occupancy(free, ~unknown | unknown).tolist() == [-1, 69, -1, 100], "a predicted obstacle stays"
    assert occupancy(free, unknown).tolist() == [-1, 69, -1, 100]
    assert occupancy(free, ~unknown).tolist() == [50, 69, 0, 100]
    assert occupancy(free, unknown).dtype == np.int8
    for value in (-0.01, 1.01, np.inf, np.nan):
        with pytest.raises(ValueError, match="expected probabilities from 0 to 1"):
            occupancy(np.array([[0.5, value]]), np.zeros((1, 2), bool))


@pytest.mark.parametrize("version", [1, 2])
def test_a_message_survives_its_serialization(version):
    ros = Ros(version)
    types = dict(ros.types)
    if version == 1:
        types["Header"] = functools.partial(types["Header"], seq=0)  # rospy and rclpy have defaults
    free, nothing = np.random.default_rng(0).random((6, 8)), np.zeros((6, 8), bool)
    predicted = StreamMap(free, ORIGIN, RESOLUTION_M, 12.25, nothing, nothing, np.zeros((0, 2)), (0.0, 0.0, 0.0))
    stamp = types["Time"](12, 250_000_000)
    message = grid_message(types, occupancy(predicted.free, predicted.unknown), predicted, stamp, "odom")
    deserialize = ros.store.deserialize_ros1 if version == 1 else ros.store.deserialize_cdr
    again = deserialize(ros.serialized(message), "nav_msgs/msg/OccupancyGrid")
    assert again.data.tolist() == occupancy(predicted.free, predicted.unknown).tolist()
    assert (again.info.width, again.info.height, again.info.resolution) == (8, 6, 0.5)
    assert (again.info.origin.position.x, again.info.origin.position.y) == ORIGIN
    assert (again.header.frame_id, again.header.stamp.sec, again.header.stamp.nanosec) == ("odom", 12, 250_000_000)


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
    scan = LaserScans(lambda _: None).convert(laser_scan(**changes), (5.0, 5.0, 5.0), STANDING)
    assert (scan.problem, scan.pose) == (problem, (1.0, 2.0, 3.0))
    assert scan.spacing == pytest.approx(spacing)
