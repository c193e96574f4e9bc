"""Maps to OccupancyGrid messages, of rclpy or rosbags, which name the fields alike."""

from typing import Any

import numpy as np

from repro.prediction.map_files import OCCUPIED_ABOVE
from repro.prediction.stream_map import StreamMap
from repro.system.errors import InputError

UNKNOWN = -1


def occupancy(free: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """Convert a map to the data of an OccupancyGrid.

    Args:
        free: probability of free, (H, W), row 0 at the top.
        unknown: pixels that no reading supports, bool, (H, W): unknown, unless an obstacle is predicted with more than
            `OCCUPIED_ABOVE`.

    Returns:
        probability of an obstacle in percent, 0 to 100, or -1 for unknown, int8, (H W,), row-major from the lower left
        corner of the map.

    Raises:
        InputError: a probability is not within [0, 1].
    """
    occupied = 1 - np.flipud(np.asarray(free, dtype=float)).ravel()
    if not ((occupied >= 0) & (occupied <= 1)).all():  # false for NaN
        raise InputError(f"expected probabilities from 0 to 1, got {np.min(free):.4g} to {np.max(free):.4g}")
    is_known = ~np.flipud(unknown).ravel() | (occupied > OCCUPIED_ABOVE)
    return np.where(is_known, np.rint(100 * occupied), UNKNOWN).astype(np.int8)


def grid_message(types: dict[str, Any], data: Any, predicted: StreamMap, stamp: Any, frame: str) -> Any:
    """Create an OccupancyGrid.

    Args:
        types: the message classes by name, of rclpy or rosbags.
        data: what `occupancy` returns, in the type that the classes take.
        predicted: the map.
        stamp: time of the map, of the type of header stamps.
        frame: frame of the map.
    """
    height, width = predicted.free.shape
    corner = types["Point"](x=float(predicted.origin[0]), y=float(predicted.origin[1]), z=0.0)
    pose = types["Pose"](position=corner, orientation=types["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0))
    resolution = float(predicted.resolution_m)
    info = types["MapMetaData"](map_load_time=stamp, resolution=resolution, width=width, height=height, origin=pose)
    return types["OccupancyGrid"](header=types["Header"](stamp=stamp, frame_id=frame), info=info, data=data)
