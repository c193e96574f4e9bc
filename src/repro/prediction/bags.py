"""Scans with poses from ROS 1 bags, ROS 2 bags and MCAP files, read by rosbags (extra `ros`)."""

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from repro.prediction.intake import LogScan
from repro.prediction.logs import ReadOptions
from repro.prediction.ros import LaserScans, add_odometry, add_transforms
from repro.prediction.transforms import Transforms
from repro.system.errors import InputError

LOGGER = logging.getLogger(__name__)
LASER, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FILTERED = ("filter", "fused", "ekf", "ukf")  # in the names of topics of estimates from several sensors
SUFFIXES = (".bag", ".db3", ".mcap")
PROFILE_START = 21  # of its name in an MCAP, after its magic and the head of its first record [bytes]
PAGE_SIZE = slice(16, 18)  # of the number in the head of a database
REPAIR = "repair it, such as with rosbag reindex, ros2 bag reindex or mcap recover"


@contextmanager
def open_bag(path: Path) -> Iterator[AnyReader]:
    """Open a bag.

    Args:
        path: a file, or the directory of a ROS 2 bag.

    Raises:
        InputError: it cannot be read, also while the context reads from it.
    """
    try:
        _check_files(path)
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
            yield bag
    except InputError:
        raise
    except Exception as error:  # rosbags and its storages raise many types for damaged files
        problem = f"{type(error).__name__}: {error}" if str(error) else "it is truncated or damaged"
        raise InputError(
            f"{path}: the bag cannot be read ({problem}): if its messages are compressed, give its directory with "
            f"metadata.yaml; if its recording was cut off, {REPAIR}"
        ) from error


def _check_files(path: Path) -> None:
    """Check the files of a bag, and that rosbags takes its name."""
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise InputError(f"{path}: is a directory without metadata.yaml, as that of a bag of ROS 2: name a file in it")
    if path.is_file() and path.suffix not in SUFFIXES:
        raise InputError(f"{path}: is a bag: expected a name that ends with {', '.join(SUFFIXES)}")
    for file in path.iterdir() if path.is_dir() else [path]:
        if file.suffix in SUFFIXES:
            _check(file)


def _check(path: Path) -> None:
    """Refuse files of which rosbags would lose or misread messages: a database that was not closed, MCAP of ROS 1."""
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size:
        raise InputError(
            f"{path}: its last messages are in {log.name}, as of a recorder that was killed: move them into it with "
            f"sqlite3 {path} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    with path.open("rb") as file:
        head = file.read(PROFILE_START + 100)
    if head.startswith(b"SQLite ") and path.stat().st_size % int.from_bytes(head[PAGE_SIZE] or b"\1", "big"):
        raise InputError(f"{path}: the bag is truncated: {REPAIR}")
    if head.startswith(b"\x89MCAP0\r") and len(head) > PROFILE_START:
        length = int.from_bytes(head[PROFILE_START - 4 : PROFILE_START], "little")
        profile = head[PROFILE_START:][:length].decode(errors="replace")
        if profile != "ros2":
            raise InputError(
                f"{path}: expected an MCAP with the profile 'ros2', got {profile!r}: give the .bag of ROS 1 that it "
                "was made from, or convert that with rosbags-convert"
            )


def bag_scans(path: Path, options: ReadOptions) -> Iterator[LogScan]:
    """Read the scans of a bag with the pose of the lidar at the middle of each scan.

    The pose is composed of the transforms from the frame of the scan up to the last parent, usually `map` or `odom`,
    and interpolated in time; odometry stands in where there is no transform. The first scan without a pose is reported.

    Args:
        path: the file, or the directory of a ROS 2 bag.
        options: topics, frame and poses. Named odometry replaces all transforms that are not static.

    Raises:
        InputError: the bag is damaged, or has no such topic, no scans or no poses.
    """
    with open_bag(path) as bag:
        topic, *others = _topics(bag, path, LASER, options.scan_topic)
        if others:
            _say_choice(path, f"scans of {topic}", others, "scan_topic")
        poses = _transforms(bag, path, options)
        converter = LaserScans(lambda message: LOGGER.warning("%s: %s", path, message))
        for _, message in _messages(bag, path, [topic]):
            times = converter.times(message)
            scan = converter.convert(message, times, poses)
            if scan.pose is None and not scan.problem:
                why = poses.why_unplaced(message.header.frame_id, times[1])
                converter.warn_once("pose", f"the first scan without a pose: {why}")
            yield scan


def _topics(bag: AnyReader, path: Path, kind: str, topic: str | None) -> list[str]:
    """Return the topics of a type with messages, those with the most first; only one if it is named."""
    topics = {name: info for name, info in bag.topics.items() if info.msgtype == kind and info.msgcount}
    if topic is not None and topic not in topics:
        raise InputError(f"{path}: no messages on {topic} of {kind}; there are {', '.join(topics) or 'none'}")
    if not topics:
        raise InputError(f"{path}: no messages of {kind}; its topics are {', '.join(bag.topics) or 'none'}")
    return [topic] if topic else sorted(topics, key=lambda name: (-topics[name].msgcount, name))


def _say_choice(path: Path, chosen: str, facts: list[str], option: str) -> None:
    LOGGER.warning("%s: %s; there are %s: prediction.%s chooses", path, chosen, ", ".join(facts), option)


def _messages(bag: AnyReader, path: Path, topics: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield the messages of some topics with their topic.

    Raises:
        InputError: fewer than the bag counts can be read; rosbags passes over damaged records.
    """
    connections = [connection for connection in bag.connections if connection.topic in topics]
    read: Counter[str] = Counter()
    for connection, _, raw in bag.messages(connections) if connections else ():
        read[connection.topic] += 1
        yield connection.topic, bag.deserialize(raw, connection.msgtype)
    for topic in topics:
        if read[topic] < bag.topics[topic].msgcount:
            raise InputError(
                f"{path}: the bag is damaged: {read[topic]} of {bag.topics[topic].msgcount} messages on {topic} can be "
                f"read; {REPAIR}"
            )


def _transforms(bag: AnyReader, path: Path, options: ReadOptions) -> Transforms:
    """Read the transforms, only the static ones for named odometry, and odometry where its frame has none."""
    transforms = Transforms(frame=options.frame, mounting=options.mounting, pose=options.pose)
    topics = sorted({connection.topic for connection in bag.connections if connection.msgtype in TRANSFORMS})
    if options.odometry_topic is not None:
        topics = [topic for topic in topics if topic.endswith("tf_static")]
    for topic, message in _messages(bag, path, topics):
        add_transforms(transforms, message, is_static=topic.endswith("tf_static"))
    has_odometry = any(info.msgtype == ODOMETRY and info.msgcount for info in bag.topics.values())
    if options.odometry_topic is not None or (has_odometry and options.pose is None):
        candidates = _topics(bag, path, ODOMETRY, options.odometry_topic)
        chosen = min(candidates, key=lambda name: not any(word in name for word in FILTERED))
        _, first = next(_messages(bag, path, [chosen]))
        if not transforms.moves(first.child_frame_id):
            for _, message in _messages(bag, path, [chosen]):
                add_odometry(transforms, message)
            if len(candidates) > 1:
                _say_choice(path, f"odometry of {chosen}", candidates, "odometry_topic")
    for text in transforms.left_out:
        LOGGER.warning("%s: %s", path, text)
    if options.pose is None and all(edge.is_static for edge in transforms.edges.values()):
        reason = next(iter(transforms.left_out), "it has neither transforms that change nor odometry")
        raise InputError(
            f"{path}: no poses: {reason}; its topics are {list(bag.topics)}. For a lidar that stands, set "
            "prediction.pose=fixed; for one that moves, add poses with a scan matcher, such as slam_toolbox"
        )
    return transforms
