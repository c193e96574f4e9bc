"""Scans with poses from ROS 1 bags, ROS 2 bags and MCAP files, read by rosbags (extra `ros`)."""

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from repro.prediction.logs import LogScan

LASER, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MAX_GAP_S = 1.0  # between two poses that are interpolated
SUFFIXES = {b"#ROSBAG": ".bag", b"\x89MCAP0\r": ".mcap", b"SQLite ": ".db3"}  # by the first seven bytes


@dataclass
class Edge:
    """The poses of one frame in its parent frame over time; one pose is a static transform."""

    parent: str
    stamps: list[float] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)

    def freeze(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s], (P,), increasing, and poses with unwrapped headings, (P, 3)."""
        order = np.argsort(self.stamps, kind="stable")
        stamps, poses = np.array(self.stamps)[order], np.array(self.poses)[order]
        poses[:, 2] = np.unwrap(poses[:, 2])
        return stamps, poses


def bag_scans(path: Path, scan_topic: str | None, odometry_topic: str | None) -> Iterator[LogScan]:
    """Read the scans of a bag with the pose of the lidar at the middle of each scan.

    The pose is composed of the transforms from the frame of the scan up to the last parent, usually `map` or `odom`,
    and interpolated in time; odometry stands in where there is no transform.

    Args:
        path: the file, or the directory of a ROS 2 bag.
        scan_topic: topic of the scans; None for the LaserScan topic with the most messages.
        odometry_topic: topic of the odometry; None for the Odometry topic with the most messages.

    Raises:
        ValueError: the bag is damaged, or has no such topic, no scans or no poses.
    """
    with tempfile.TemporaryDirectory() as directory:
        try:
            with AnyReader(
                [_with_suffix(path, Path(directory))], default_typestore=get_typestore(Stores.LATEST)
            ) as bag:
                scans = _topic(bag, path, [LASER], scan_topic)
                edges = _edges(bag, path, odometry_topic)
                for connection, _, raw in bag.messages([c for c in bag.connections if c.topic == scans]):
                    yield _scan(bag.deserialize(raw, connection.msgtype), edges)
        except ValueError:
            raise
        except Exception as error:  # rosbags and its storages raise many types for damaged files
            raise ValueError(f"{path}: the bag cannot be read ({type(error).__name__}: {error})") from error


def _with_suffix(path: Path, directory: Path) -> Path:
    """Return a path to the bag with the suffix that rosbags expects of its content."""
    if path.is_dir():
        return path
    with path.open("rb") as file:
        suffix = SUFFIXES[file.read(7)]
    if path.suffix == suffix:
        return path
    link = directory / f"bag{suffix}"
    link.symlink_to(path.absolute())
    return link


def _topic(bag: AnyReader, path: Path, types: list[str], topic: str | None) -> str:
    topics = {name: info for name, info in bag.topics.items() if info.msgtype in types and info.msgcount}
    if topic is not None and topic not in topics:
        raise ValueError(f"{path}: no messages on {topic} of {types[0]}; there are {', '.join(topics) or 'none'}")
    if not topics:
        raise ValueError(f"{path}: no messages of {types[0]}; its topics are {', '.join(bag.topics) or 'none'}")
    return topic or max(topics, key=lambda name: topics[name].msgcount)


def _edges(bag: AnyReader, path: Path, odometry_topic: str | None) -> dict[str, tuple[str, np.ndarray, np.ndarray]]:
    """Read all transforms, and odometry where its frame has none: parent, times and poses by frame."""
    edges: dict[str, Edge] = {}
    transforms = [connection for connection in bag.connections if connection.msgtype in TRANSFORMS]
    if odometry_topic is None:
        for connection, _, raw in bag.messages(transforms) if transforms else ():
            transforms_of: Any = bag.deserialize(raw, connection.msgtype)
            for message in transforms_of.transforms:
                pose = _pose(message.transform.translation, message.transform.rotation)
                _add(edges, message.child_frame_id, message.header, pose)
    has_odometry = any(info.msgtype == ODOMETRY and info.msgcount for info in bag.topics.values())
    if odometry_topic is not None or has_odometry:
        topic = _topic(bag, path, [ODOMETRY], odometry_topic)
        moving: dict[str, Edge] = {}
        for connection, _, raw in bag.messages([c for c in bag.connections if c.topic == topic]):
            odometry: Any = bag.deserialize(raw, connection.msgtype)
            pose = _pose(odometry.pose.pose.position, odometry.pose.pose.orientation)
            _add(moving, odometry.child_frame_id, odometry.header, pose)
        edges = moving | edges
    if not edges:
        raise ValueError(f"{path}: no poses: it has neither transforms nor odometry; its topics are {list(bag.topics)}")
    return {frame: (edge.parent, *edge.freeze()) for frame, edge in edges.items()}


def _add(edges: dict[str, Edge], child: str, header: Any, pose: tuple[float, float, float]) -> None:
    edge = edges.setdefault(_frame(child), Edge(_frame(header.frame_id)))
    edge.stamps.append(_seconds(header.stamp))
    edge.poses.append(pose)


def _scan(message: Any, edges: dict[str, tuple[str, np.ndarray, np.ndarray]]) -> LogScan:
    ranges = np.asarray(message.ranges, dtype=np.float32)
    stamp = _seconds(message.header.stamp)
    middle = stamp + max(float(message.time_increment), 0.0) * (len(ranges) - 1) / 2
    pose = _pose_at(_frame(message.header.frame_id), middle, edges)
    first, spacing = float(message.angle_min), float(message.angle_increment)
    return LogScan(stamp, ranges, first, spacing, float(message.range_min), float(message.range_max), pose)


def _pose_at(
    frame: str, stamp: float, edges: dict[str, tuple[str, np.ndarray, np.ndarray]]
) -> tuple[float, float, float] | None:
    """Return the pose of a frame in its last parent; None where a transform on the way is not known at that time.

    A lidar without a transform is taken to be at the origin of the frame that moves.
    """
    if frame not in edges:
        frame = max(edges, key=lambda name: len(edges[name][1]))
    x, y, heading = 0.0, 0.0, 0.0
    for _ in range(len(edges)):  # no more steps than frames, so that a cycle ends
        if frame not in edges:
            break
        frame, stamps, poses = edges[frame]
        found = _interpolate(stamp, stamps, poses)
        if found is None:
            return None
        dx, dy, turn = found
        x, y = dx + math.cos(turn) * x - math.sin(turn) * y, dy + math.sin(turn) * x + math.cos(turn) * y
        heading += turn
    return x, y, heading


def _interpolate(stamp: float, stamps: np.ndarray, poses: np.ndarray) -> np.ndarray | None:
    if len(stamps) == 1:
        return poses[0]
    after = int(np.searchsorted(stamps, stamp))
    if after == 0 or after == len(stamps):
        nearest = poses[0] if after == 0 else poses[-1]
        return nearest if abs(stamp - stamps[0 if after == 0 else -1]) <= MAX_GAP_S / 10 else None
    gap = stamps[after] - stamps[after - 1]
    if gap > MAX_GAP_S:
        return None
    share = (stamp - stamps[after - 1]) / gap if gap > 0 else 0.0
    return poses[after - 1] + share * (poses[after] - poses[after - 1])


def _pose(position: Any, rotation: Any) -> tuple[float, float, float]:
    """Return x, y and the heading of a quaternion."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    return position.x, position.y, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _frame(name: str) -> str:
    return name.lstrip("/")
