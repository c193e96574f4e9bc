"""Scans with poses from ROS 1 bags, ROS 2 bags and MCAP files, read by rosbags (extra `ros`)."""

import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from repro.prediction.readings import LogScan
from repro.prediction.ros import add_odometry, add_transforms, log_scan, middle_of
from repro.prediction.transforms import Transforms, without_transform
from repro.system.errors import InputError

LASER, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
SUFFIXES = {b"#ROSBAG": ".bag", b"\x89MCAP0\r": ".mcap", b"SQLite ": ".db3"}  # by the first seven bytes


def bag_scans(path: Path, scan_topic: str | None, odometry_topic: str | None) -> Iterator[LogScan]:
    """Read the scans of a bag with the pose of the lidar at the middle of each scan.

    The pose is composed of the transforms from the frame of the scan up to the last parent, usually `map` or `odom`,
    and interpolated in time; odometry stands in where there is no transform. A lidar whose frame has no transform is
    reported once; see `Transforms.base_of`.

    Args:
        path: the file, or the directory of a ROS 2 bag.
        scan_topic: topic of the scans; None for the LaserScan topic with the most messages.
        odometry_topic: topic of the odometry, which then replaces all transforms that are not static; None for the
            Odometry topic with the most messages, which only adds to the transforms.

    Raises:
        ValueError: the bag is damaged, or has no such topic, no scans or no poses.
    """
    with tempfile.TemporaryDirectory() as directory:
        try:
            with AnyReader(
                [_with_suffix(path, Path(directory))], default_typestore=get_typestore(Stores.LATEST)
            ) as bag:
                scans = _topic(bag, path, [LASER], scan_topic)
                transforms = _transforms(bag, path, odometry_topic)
                reported, is_explained = set[str](), False
                for _, message in _messages(bag, path, [c for c in bag.connections if c.topic == scans]):
                    frame = message.header.frame_id
                    if frame not in transforms and frame not in reported:
                        reported.add(frame)
                        print(f"{path}: {without_transform(frame, transforms.base_of(frame))}", flush=True)
                    scan = log_scan(message, transforms)
                    if scan.pose is None and not is_explained:
                        is_explained = True
                        why = transforms.why_unplaced(frame, middle_of(message))
                        print(f"{path}: the first scan without a pose: {why}", flush=True)
                    yield scan
        except InputError:
            raise
        except Exception as error:  # rosbags and its storages raise many types for damaged files
            raise InputError(f"{path}: the bag cannot be read ({type(error).__name__}: {error})") from error


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
        raise InputError(f"{path}: no messages on {topic} of {types[0]}; there are {', '.join(topics) or 'none'}")
    if not topics:
        raise InputError(f"{path}: no messages of {types[0]}; its topics are {', '.join(bag.topics) or 'none'}")
    return topic or max(topics, key=lambda name: topics[name].msgcount)


def _messages(bag: AnyReader, path: Path, connections: list[Connection]) -> Iterator[tuple[Connection, Any]]:
    """Yield the messages of some connections.

    Raises:
        ValueError: fewer than the bag counts can be read; rosbags passes over damaged records.
    """
    counts = {connection.topic: bag.topics[connection.topic].msgcount for connection in connections}
    read: Counter[str] = Counter()
    for connection, _, raw in bag.messages(connections) if connections else ():
        read[connection.topic] += 1
        yield connection, bag.deserialize(raw, connection.msgtype)
    for topic, count in counts.items():
        if read[topic] < count:
            raise InputError(
                f"{path}: the bag is damaged: {read[topic]} of {count} messages on {topic} can be read; repair it, "
                "such as with rosbag reindex, ros2 bag reindex or mcap recover"
            )


def _transforms(bag: AnyReader, path: Path, odometry_topic: str | None) -> Transforms:
    """Read the transforms, only the static ones for named odometry, and odometry where its frame has none."""
    transforms, moving = Transforms(), Transforms()
    connections = [connection for connection in bag.connections if connection.msgtype in TRANSFORMS]
    if odometry_topic is not None:
        connections = [connection for connection in connections if _is_static(connection)]
    for connection, message in _messages(bag, path, connections):
        add_transforms(transforms, message, is_static=_is_static(connection))
    has_odometry = any(info.msgtype == ODOMETRY and info.msgcount for info in bag.topics.values())
    if odometry_topic is not None or has_odometry:
        topic = _topic(bag, path, [ODOMETRY], odometry_topic)
        for _, message in _messages(bag, path, [c for c in bag.connections if c.topic == topic]):
            add_odometry(moving, message)
    left_out = [*transforms.left_out, *moving.left_out]
    for child in moving.edges:
        if child in transforms.edges and transforms.edges[child].is_static:
            left_out.append(f"odometry of {child} is left out: a static transform places it elsewhere")
    transforms.edges = moving.edges | transforms.edges
    for message in left_out:
        print(f"{path}: {message}", flush=True)
    if all(edge.is_static for edge in transforms.edges.values()):
        reason = left_out[-1] if moving.edges else "it has neither transforms that change nor odometry"
        raise InputError(f"{path}: no poses: {reason}; its topics are {list(bag.topics)}")
    return transforms


def _is_static(connection: Connection) -> bool:
    return connection.topic.endswith("tf_static")
