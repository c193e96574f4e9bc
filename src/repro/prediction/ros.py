"""ROS messages to scans and poses, and maps to messages, for ROS 1, ROS 2 and rosbags, which name the fields alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from repro.prediction.readings import LogScan
from repro.prediction.transforms import Transforms
from repro.system.errors import InputError

if TYPE_CHECKING:
    from repro.prediction.stream import StreamMap

UNKNOWN = -1


def seconds(stamp: Any) -> float:
    """Return the time of a stamp [s]."""
    if hasattr(stamp, "nanosec"):
        return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return float(stamp.secs) + 1e-9 * float(stamp.nsecs)  # of rospy


def add_transforms(transforms: Transforms, message: Any, *, is_static: bool = False) -> None:
    """Add the transforms of a TFMessage."""
    for each in message.transforms:
        _add(transforms, each, each.transform.translation, each.transform.rotation, is_static=is_static)


def add_odometry(transforms: Transforms, message: Any) -> None:
    """Add the pose of an Odometry message."""
    _add(transforms, message, message.pose.pose.position, message.pose.pose.orientation)


def _add(transforms: Transforms, message: Any, place: Any, turn: Any, *, is_static: bool = False) -> None:
    position, quaternion = (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
    stamp, parent = seconds(message.header.stamp), message.header.frame_id
    transforms.add(message.child_frame_id, parent, stamp, position, quaternion, is_static=is_static)


def middle_of(message: Any) -> float:
    """Return the time of the middle of a LaserScan [s], at which its pose is taken."""
    increment = max(float(message.time_increment), 0.0)
    return seconds(message.header.stamp) + increment * (len(message.ranges) - 1) / 2


def log_scan(message: Any, transforms: Transforms) -> LogScan:
    """Convert a LaserScan, with the pose of its frame in the middle of the scan.

    The angles of a lidar that is mounted upside down are negated, so that they count counterclockwise on the map.

    Raises:
        ValueError: the lidar is tilted.
    """
    placed = transforms.pose_at(message.header.frame_id, middle_of(message))
    sense = -1 if placed and placed.is_upside_down else 1
    return LogScan(
        stamp=seconds(message.header.stamp),
        ranges=np.asarray(message.ranges, dtype=np.float32),
        first_angle=sense * float(message.angle_min),
        spacing=sense * float(message.angle_increment),
        range_min_m=float(message.range_min),
        range_max_m=float(message.range_max),
        pose=(placed.x, placed.y, placed.heading) if placed else None,
    )


def occupancy(free: np.ndarray, undecided: tuple[float, float] | None = None) -> np.ndarray:
    """Convert a map to the data of an OccupancyGrid.

    Args:
        free: probability of free, (H, W), row 0 at the top; NaN is unknown.
        undecided: probabilities of an obstacle between these two are unknown, too; None for none.

    Returns:
        probability of an obstacle in percent, 0 to 100, or -1 for unknown, int8, (H W,), row-major from the lower left
        corner of the map.

    Raises:
        ValueError: a probability is outside [0, 1].
    """
    occupied = 1 - np.flipud(np.asarray(free, dtype=float)).ravel()
    is_known = ~np.isnan(occupied)
    if ((occupied[is_known] < 0) | (occupied[is_known] > 1)).any():
        raise InputError(f"expected probabilities from 0 to 1, got {np.nanmin(free):.4g} to {np.nanmax(free):.4g}")
    if undecided is not None:
        is_known &= (occupied <= undecided[0]) | (occupied >= undecided[1])
    return np.where(is_known, np.rint(100 * np.where(is_known, occupied, 0)), UNKNOWN).astype(np.int8)


def grid_message(types: dict[str, Any], data: Any, predicted: StreamMap, stamp: Any, frame: str) -> Any:
    """Create an OccupancyGrid.

    Args:
        types: the message classes `GRID_TYPES` by name, of rospy, rclpy or rosbags.
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
