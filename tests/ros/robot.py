"""The messages of a robot with a mounted lidar: the scans of a log, and tf at 50 Hz between them."""

import array
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

STEP_S, TF_S, RANGE_MAX_M = 0.1, 0.02, 30.0
MOUNT_M = 0.2  # of the lidar in front of the center of the robot


def _transform(stamp: Any, parent: str, child: str, pose: tuple[float, float, float]) -> TFMessage:
    x, y, heading = map(float, pose)
    moved = TransformStamped(header=Header(stamp=stamp, frame_id=parent), child_frame_id=child)
    moved.transform.translation = Vector3(x=x, y=y, z=0.0)
    moved.transform.rotation = Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
    return TFMessage(transforms=[moved])


def mounting(stamp: Any) -> TFMessage:
    """Return the transform of the lidar on the robot."""
    return _transform(stamp, "base_link", "laser", (MOUNT_M, 0.0, 0.0))


def messages(path: str, scans: int, stamp: Callable[[float], Any]) -> Iterator[tuple[float, Any]]:
    """Yield the time since the start [s] and the message of each scan and each pose, in the order of time.

    Args:
        path: the log, an npz.
        scans: number of scans.
        stamp: the stamp of a time since the start [s].
    """
    with np.load(path) as content:
        ranges, angles, poses = (content[name] for name in ("ranges", "angles", "poses"))
    events = [(STEP_S * step, step) for step in range(scans)]
    events += [(time, None) for time in np.arange(0.007 - TF_S, STEP_S * scans + TF_S, TF_S)]
    for time, step in sorted(events, key=lambda event: event[0]):
        if step is not None:
            yield time, _scan(stamp(time), ranges[step], angles)
            continue
        x, y, heading = (np.interp(time / STEP_S, np.arange(len(poses)), column) for column in poses.T)
        base = (x - MOUNT_M * math.cos(heading), y - MOUNT_M * math.sin(heading), heading)
        yield time, _transform(stamp(time), "odom", "base_link", base)


def _scan(stamp: Any, ranges: np.ndarray, angles: np.ndarray) -> LaserScan:
    first, last = float(angles[0]), float(angles[-1])
    scan = LaserScan(header=Header(stamp=stamp, frame_id="laser"), angle_min=first, angle_max=last)
    scan.angle_increment = (last - first) / (len(angles) - 1)
    scan.range_min, scan.range_max, scan.ranges = 0.0, RANGE_MAX_M, array.array("f", ranges)
    return scan
