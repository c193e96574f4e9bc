"""The predictions of a log as one MCAP file with ROS 2 messages, for Foxglove and RViz."""

import math
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from repro.prediction.logs import ScanLog
from repro.prediction.ros import grid_message, occupancy
from repro.prediction.stream import StreamMap
from repro.system.errors import InputError

MAP_FRAME, LASER_FRAME = "map", "laser"
STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = {name.rpartition("/")[2]: kind for name, kind in STORE.types.items()}
TOPICS = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/pose": "geometry_msgs/msg/PoseStamped",
    "/predicted_map": "nav_msgs/msg/OccupancyGrid",
}


def write_mcap(path: Path, log: ScanLog, maps: Iterable[StreamMap], range_max_m: float) -> None:
    """Write the scans and poses of a log with its predicted maps.

    Topics: /scan (LaserScan in the frame `laser`), /tf (`laser` in `map`, the frame of the log), /pose (PoseStamped),
    /predicted_map (OccupancyGrid).

    Args:
        path: the file to create or replace.
        log: the log.
        maps: the maps, in the order of the scans that end their windows.
        range_max_m: maximum range of the lidar, if no hit of the log is farther [m].

    Raises:
        ValueError: see `check_times`.
    """
    check_times(log)
    farthest = np.max(log.ranges, where=np.isfinite(log.ranges), initial=0)
    beyond = np.nextafter(farthest, np.float32(np.inf), dtype=np.float32)  # LaserScan has 32 bits
    range_max_m = max(range_max_m, float(beyond))
    messages = _with_grids(_scans(log, range_max_m), iter(maps))
    with tempfile.TemporaryDirectory(dir=path.parent) as directory:
        writer = Writer(Path(directory) / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            topics = {topic: writer.add_connection(topic, kind, typestore=STORE) for topic, kind in TOPICS.items()}
            for stamp, topic, message in messages:
                writer.write(topics[topic], _nanoseconds(stamp), STORE.serialize_cdr(message, TOPICS[topic]))
        (Path(directory) / "bag" / "bag.mcap").replace(path)


def check_times(log: ScanLog) -> None:
    """Check that ROS can represent the times of a log.

    Raises:
        ValueError: it begins before time 0, or ends after 2**31 s.
    """
    first, last = log.stamps.min(), log.stamps.max()
    if first < 0 or last >= 2**31:
        raise InputError(f"the times of the log are {first:.2f} to {last:.2f} s: an MCAP takes 0 to 2**31")


def _scans(log: ScanLog, range_max_m: float) -> Iterator[tuple[float, str, Any]]:
    """Yield the transform, the scan and the pose of each step with its time [s]."""
    increment = float((log.angles[-1] - log.angles[0]) / (len(log.angles) - 1))
    limits: dict[str, Any] = {
        "angle_min": float(log.angles[0]),
        "angle_max": float(log.angles[-1]),
        "angle_increment": increment,
        "time_increment": 0.0,
        "scan_time": float(np.median(np.diff(log.stamps))),
        "range_min": 0.0,
        "range_max": range_max_m,
        "intensities": np.zeros(0, np.float32),
    }
    for time, ranges, (x, y, heading) in zip(log.stamps, log.ranges, log.poses, strict=True):
        stamp, place = float(time), {"x": float(x), "y": float(y), "z": 0.0}
        turn = TYPES["Quaternion"](x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
        moved = TYPES["Transform"](translation=TYPES["Vector3"](**place), rotation=turn)
        transform = TYPES["TransformStamped"](_header(stamp, MAP_FRAME), child_frame_id=LASER_FRAME, transform=moved)
        yield stamp, "/tf", TYPES["TFMessage"](transforms=[transform])
        yield stamp, "/scan", TYPES["LaserScan"](_header(stamp, LASER_FRAME), ranges=ranges, **limits)
        pose = TYPES["Pose"](position=TYPES["Point"](**place), orientation=turn)
        yield stamp, "/pose", TYPES["PoseStamped"](_header(stamp, MAP_FRAME), pose=pose)


def _with_grids(
    messages: Iterator[tuple[float, str, Any]], maps: Iterator[StreamMap]
) -> Iterator[tuple[float, str, Any]]:
    """Yield the messages of the scans, and after each scan that ends a window its map; time may be set back."""
    predicted = next(maps, None)
    for stamp, topic, message in messages:
        yield stamp, topic, message
        if topic == "/pose" and predicted is not None and predicted.stamp == stamp:
            data = occupancy(predicted.free, unknown=predicted.unknown)
            yield stamp, "/predicted_map", grid_message(TYPES, data, predicted, _time(stamp), MAP_FRAME)
            predicted = next(maps, None)


def _header(stamp: float, frame: str) -> Any:
    return TYPES["Header"](stamp=_time(stamp), frame_id=frame)


def _time(stamp: float) -> Any:
    sec, nanosec = divmod(_nanoseconds(stamp), 10**9)
    return TYPES["Time"](sec=sec, nanosec=nanosec)


def _nanoseconds(stamp: float) -> int:
    return round(stamp * 1e9)
