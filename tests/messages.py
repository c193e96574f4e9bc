"""Messages of ROS 1 and ROS 2, made with the types of rosbags."""

import math
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


class Ros:
    """The messages of one version of ROS; times in seconds, poses as x, y [m] and heading [rad]."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        if version == 1:  # which rosbags does not list for ROS 1
            transforms = get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            self.store.register(transforms)
        self.types = {name.rpartition("/")[2]: kind for name, kind in self.store.types.items()}
        self.types["Time"] = self.store.types["builtin_interfaces/msg/Time"]  # ROS 1 has a message of this name, too

    def serialized(self, message: Any) -> bytes:
        serialize = self.store.serialize_ros1 if self.version == 1 else self.store.serialize_cdr
        return bytes(serialize(message, message.__msgtype__))

    def header(self, stamp: float, frame: str) -> Any:
        sequence = (0,) if self.version == 1 else ()
        return self.types["Header"](*sequence, self.types["Time"](*divmod(round(stamp * 1e9), 10**9)), frame)

    def rotation(self, heading: float) -> Any:
        return self.types["Quaternion"](0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))

    def transform(self, stamp: float, parent: str, child: str, pose, rotation: Any = None) -> Any:
        """Return a TFMessage with one transform, whose rotation may be no heading."""
        place = self.types["Vector3"](float(pose[0]), float(pose[1]), 0.0)
        moved = self.types["Transform"](place, rotation or self.rotation(pose[2]))
        return self.types["TFMessage"]([self.types["TransformStamped"](self.header(stamp, parent), child, moved)])

    def odometry(self, stamp: float, pose, child: str) -> Any:
        types = self.types
        point, zero = types["Point"](float(pose[0]), float(pose[1]), 0.0), types["Vector3"](0.0, 0.0, 0.0)
        placed = types["PoseWithCovariance"](types["Pose"](point, self.rotation(pose[2])), np.zeros(36))
        twist = types["TwistWithCovariance"](types["Twist"](zero, zero), np.zeros(36))
        return types["Odometry"](self.header(stamp, "odom"), child, placed, twist)

    def stamped(self, kind: str, stamp: float, pose) -> Any:
        """Return a PoseStamped or a PoseWithCovarianceStamped in the frame `map`."""
        types = self.types
        placed = types["Pose"](types["Point"](float(pose[0]), float(pose[1]), 0.0), self.rotation(pose[2]))
        placed = placed if kind == "PoseStamped" else types["PoseWithCovariance"](placed, np.zeros(36))
        return types[kind](self.header(stamp, "map"), placed)

    def scan(self, stamp: float, angles: np.ndarray, ranges: np.ndarray, **changes) -> Any:
        """Return a LaserScan in the frame `laser`, up to 30 m; `angle_max` follows from the other fields."""
        increment = float((angles[-1] - angles[0]) / (len(angles) - 1))
        values = {"angle_min": float(angles[0]), "angle_increment": increment, "time_increment": 0.0, "scan_time": 0.1}
        values |= {"range_min": 0.0, "range_max": 30.0, "ranges": np.asarray(ranges, np.float32)} | changes
        values.setdefault("angle_max", values["angle_min"] + values["angle_increment"] * (len(values["ranges"]) - 1))
        empty = np.zeros(0, np.float32)
        return self.types["LaserScan"](self.header(stamp, "laser"), **values, intensities=empty)
