"""Messages from maps, checked by the types of rosbags and by the definition of OccupancyGrid."""

import numpy as np
import pytest
from messages import Ros

from repro.logs.transforms import Transforms
from repro.maps.grid import Grid
from repro.prediction.stream_map import StreamMap
from repro.ros.map_message import grid_message, occupancy

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


def test_a_message_survives_its_serialization():
    free, nothing = np.random.default_rng(0).random((6, 8)), np.zeros((6, 8), bool)
    predicted = StreamMap(free, ORIGIN, RESOLUTION_M, 12.25, nothing, nothing, np.zeros((0, 2)), (0.0, 0.0, 0.0))
    stamp = ROS.types["Time"](12, 250_000_000)
    message = grid_message(ROS.types, occupancy(predicted.free, predicted.unknown), predicted, stamp, "odom")
    again = ROS.store.deserialize_cdr(ROS.serialized(message), "nav_msgs/msg/OccupancyGrid")
    assert again.data.tolist() == occupancy(predicted.free, predicted.unknown).tolist()
    assert (again.info.width, again.info.height, again.info.resolution) == (8, 6, 0.5)
    assert (again.info.origin.position.x, again.info.origin.position.y) == ORIGIN
    assert (again.header.frame_id, again.header.stamp.sec, again.header.stamp.nanosec) == ("odom", 12, 250_000_000)
