"""Scans with poses from ROS 1 bags, ROS 2 bags and MCAP files, read by rosbags (extra `ros`)."""

import logging
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from repro.logs.bag_files import REPAIR, check_files
from repro.logs.log_scan import LogScan
from repro.logs.messages import LaserScans, add_odometry, add_pose, add_transforms, seconds
from repro.logs.options import ReadOptions
from repro.logs.poses import DISORDER_S
from repro.logs.transforms import BASES, Transforms
from repro.system.errors import InputError, printable

LOGGER = logging.getLogger(__name__)
LASER, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseWithCovarianceStamped", "geometry_msgs/msg/PoseStamped")
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FILTERED = ("filter", "fused", "ekf", "ukf")  # in the names of topics of estimates from several sensors
AROUND_S = 2.0  # a reset of the clock, in which messages of before and after it are mixed


@contextmanager
def open_bag(paths: Sequence[Path]) -> Iterator[AnyReader]:
    """Open a bag.

    Args:
        paths: its files, or the directories of bags of ROS 2.

    Raises:
        InputError: it cannot be read, also while the context reads from it.
    """
    try:
        for path in paths:
            check_files(path)
        with AnyReader(paths, default_typestore=get_typestore(Stores.LATEST)) as bag:
            yield bag
    except InputError:
        raise
    except Exception as error:  # rosbags and its storages raise many types for damaged files
        problem = f"{type(error).__name__}: {error}" if str(error) else "it is truncated or damaged"
        raise InputError(
            f"{paths[0]}: the bag cannot be read ({problem}): if its messages are compressed, give its directory with "
            f"metadata.yaml; if its recording was cut off, {REPAIR}"
        ) from error


def bag_scans(paths: Sequence[Path], options: ReadOptions) -> Iterator[LogScan]:
    """Read the scans of a bag with the pose of the lidar at the middle of each scan.

    The pose is composed of the transforms from the frame of the scan up to the last parent, usually `map` or `odom`,
    and interpolated in time; odometry or stamped poses stand in where there is no transform. Topics in the namespace of
    the scans go before others. A bag in which the clock was set back has several runs, each with its own poses. The
    first scan without a pose is reported.

    Args:
        paths: its files, or the directories of bags of ROS 2.
        options: topics, frame and poses. Named odometry replaces all transforms that are not static.

    Raises:
        InputError: the bag is damaged, or has no such topic, no scans or no poses.
    """
    with open_bag(paths) as bag:
        reader = _Bag(bag, paths[0], options)
        converter = LaserScans(reader.warn)
        frames: dict[str, None] = {}
        for ns, message in reader.messages(reader.scan_topic):
            poses = reader.poses_of(ns, seconds(message.header.stamp))
            times, frame = converter.times(message), message.header.frame_id
            scan = converter.convert(message, times, poses)
            if scan.pose is None and not scan.problem:
                why = poses.why_unplaced(frame, times.middle_s)
                converter.warn_once("pose", f"the first scan without a pose: {why}")
            frames[frame] = None
            if len(frames) == 2:
                converter.warn_once("frames", f"{reader.scan_topic} has scans of several lidars, {', '.join(frames)}")
            yield scan


class _Bag:
    """A bag with the choice of its topics and the poses of its runs."""

    def __init__(self, bag: AnyReader, path: Path, options: ReadOptions) -> None:
        self.bag, self.path, self.options = bag, path, options
        self.scan_topic, *others = self._topics((LASER,), options.scan_topic)
        if others:
            self._say_choice(f"scans of {self.scan_topic}", others, "scan_topic")
        self._resets = self._find_resets()
        self._runs = [
            Transforms(frame=options.frame, mounting=options.mounting, pose=options.pose)
            for _ in range(1 + len(self._resets))
        ]
        if self._resets:
            self.warn(f"the clock was set back {len(self._resets)} times: the poses of its runs are kept apart")
        self._read_poses()

    def warn(self, text: str) -> None:
        LOGGER.warning("%s: %s", self.path, printable(text))

    def poses_of(self, ns: int, stamp: float) -> Transforms:
        """Return the poses of the run of a message, given the time of its record [ns] and its stamp [s]."""
        run = 0
        for number, (reset_ns, before_s, after_s) in enumerate(self._resets, 1):
            is_near = abs(ns - reset_ns) <= AROUND_S * 1e9
            if abs(stamp - after_s) < abs(stamp - before_s) if is_near else ns >= reset_ns:
                run = number
        return self._runs[run]

    def messages(self, *topics: str) -> Iterator[tuple[int, Any]]:
        """Yield the messages of some topics with the times of their records [ns].

        Raises:
            InputError: fewer than the bag counts can be read; rosbags passes over damaged records.
        """
        connections = [connection for connection in self.bag.connections if connection.topic in topics]
        read: Counter[str] = Counter()
        for connection, ns, raw in self.bag.messages(connections) if connections else ():
            read[connection.topic] += 1
            yield ns, self.bag.deserialize(raw, connection.msgtype)
        for topic in topics:
            if read[topic] < self.bag.topics[topic].msgcount:
                raise InputError(
                    f"{self.path}: the bag is damaged: {read[topic]} of {self.bag.topics[topic].msgcount} messages on "
                    f"{topic} can be read; {REPAIR}"
                )

    def _topics(self, kinds: tuple[str, ...], topic: str | None) -> list[str]:
        """Return the topics of some types with messages, those with the most first; only one if it is named."""
        all_topics = self.bag.topics
        topics = {name: info for name, info in all_topics.items() if info.msgtype in kinds and info.msgcount}
        if topic is not None and topic not in topics:
            raise InputError(
                f"{self.path}: no messages on {topic} of {' or '.join(kinds)}; there are {', '.join(topics) or 'none'}"
            )
        if not topics:
            known = ", ".join(all_topics) or "none"
            more = "; if the scans are in another file, name both: scans=[a.bag,b.bag]" if kinds == (LASER,) else ""
            raise InputError(f"{self.path}: no messages of {' or '.join(kinds)}; its topics are {known}{more}")
        return [topic] if topic else sorted(topics, key=lambda name: (-topics[name].msgcount, name))

    def _say_choice(self, chosen: str, facts: list[str], option: str) -> None:
        self.warn(f"{chosen}; there are {', '.join(facts)}: prediction.{option} chooses")

    def _find_resets(self) -> list[tuple[int, float, float]]:
        """Return where the clock was set back: time of the record [ns], and the stamps before and after [s]."""
        last_s, resets = -float("inf"), []
        for ns, message in self.messages(self.scan_topic):
            stamp = seconds(message.header.stamp)
            if stamp < last_s - DISORDER_S:
                resets.append((ns, last_s, stamp))
            last_s = stamp
        return resets

    def _of_robot(self, topics: list[str]) -> list[str]:
        """Return those of some topics whose names have most words in common with that of the scans, and fewest others.

        Two robots may have frames of equal names below `/robot1/tf` and `/robot2/tf`.
        """
        own = _words(self.scan_topic)
        ranks = {topic: (-len(_words(topic) & own), len(_words(topic) - own)) for topic in topics}
        chosen = [topic for topic in topics if ranks[topic] == min(ranks.values())]
        if others := [topic for topic in topics if topic not in chosen]:
            self.warn(f"transforms of {', '.join(chosen)}, not of {', '.join(others)}, for scans of {self.scan_topic}")
        return chosen

    def _read_poses(self) -> None:
        """Read the transforms, only the static ones for named odometry, and odometry where its frame has none."""
        options = self.options
        topics = sorted({connection.topic for connection in self.bag.connections if connection.msgtype in TRANSFORMS})
        for is_static in (True, False):
            if is_static or options.odometry_topic is None:
                found = self._of_robot([topic for topic in topics if topic.endswith("tf_static") == is_static])
                for ns, message in self.messages(*found):
                    self._add(ns, message, is_static=is_static)
        if options.odometry_topic is not None or options.pose is None:
            self._read_odometry()
        left_out = {text: None for run in self._runs for text in run.left_out}
        for text in left_out:
            self.warn(text)
        if options.pose is None and all(edge.is_static for run in self._runs for edge in run.edges.values()):
            reason = next(iter(left_out), "it has neither transforms that change nor odometry nor stamped poses")
            raise InputError(
                f"{self.path}: no poses: {reason}; its topics are {list(self.bag.topics)}. If another file has them, "
                "name both: scans=[a.bag,b.bag]. For a lidar that stands, set prediction.pose=fixed; for one that "
                "moves, add poses with a scan matcher, such as slam_toolbox"
            )

    def _add(self, ns: int, message: Any, *, is_static: bool) -> None:
        """Add a TFMessage to the run of its time, to all runs if it is static."""
        if is_static or not message.transforms:
            for run in self._runs:
                add_transforms(run, message, is_static=is_static)
        else:
            add_transforms(self.poses_of(ns, seconds(message.transforms[0].header.stamp)), message)

    def _read_odometry(self) -> None:
        """Read the named odometry, or the best one whose frame has no transforms, or stamped poses if nothing moves."""
        named, types = self.options.odometry_topic, {name: info.msgtype for name, info in self.bag.topics.items()}
        kinds: tuple[str, ...] = (ODOMETRY, *POSES)
        if named is None:
            with_messages = {info.msgtype for info in self.bag.topics.values() if info.msgcount}
            moves = any(not edge.is_static for run in self._runs for edge in run.edges.values())
            kinds = (ODOMETRY,) if ODOMETRY in with_messages else POSES
            if not with_messages & set(kinds) or (moves and kinds == POSES):
                return
        candidates, own = self._topics(kinds, named), _words(self.scan_topic)

        def rank(name: str) -> tuple[int, bool]:
            return -len(_words(name) & own), not any(word in name for word in FILTERED)

        chosen = min(candidates, key=rank)
        _, first = next(self.messages(chosen))
        if types[chosen] == ODOMETRY and any(run.moves(first.child_frame_id) for run in self._runs):
            return
        _, scan = next(self.messages(self.scan_topic))
        robot = self._runs[0].root(scan.header.frame_id)
        robot = BASES[0] if robot == scan.header.frame_id.lstrip("/") else robot
        for ns, message in self.messages(chosen):
            poses = self.poses_of(ns, seconds(message.header.stamp))
            if types[chosen] == ODOMETRY:
                add_odometry(poses, message)
            else:
                add_pose(poses, message, robot)
        if len(candidates) > 1:
            self._say_choice(f"odometry of {chosen}", candidates, "odometry_topic")


def _words(topic: str) -> set[str]:
    """Return the words in the name of a topic."""
    return set(filter(None, re.split(r"[/_]", topic)))
