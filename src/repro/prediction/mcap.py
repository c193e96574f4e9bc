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
        InputError: see `check_times`.
    """
    check_times(log)
    farthest = np.max(log.ranges, where=np.isfinite(log.ranges), initial=0)
    beyond = np.nextafter(farthest, np.float32(np.inf), dtype=np.float32)  # LaserScan has 32 bits
    with tempfile.TemporaryDirectory(dir=path.parent) as directory:
        writer = Writer(Path(directory) / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            topics = {topic: writer.add_connection(topic, kind, typestore=STORE) for topic, kind in TOPICS.items()}
            for stamp, topic, message in _messages(log, iter(maps), max(range_max_m, float(beyond))):
                writer.write(topics[topic], round(stamp * 1e9), STORE.serialize_cdr(message, TOPICS[topic]))
        (Path(directory) / "bag" / "bag.mcap").replace(path)


def check_times(log: ScanLog) -> None:
    """Refuse a log that begins before time 0 or ends after 2**31 s, which ROS cannot represent."""
    first, last = log.stamps.min(), log.stamps.max()
    if first < 0 or last >= 2**31:
        raise InputError(f"the times of the log are {first:.2f} to {last:.2f} s: an MCAP takes 0 to 2**31")


def _messages(log: ScanLog, maps: Iterator[StreamMap], range_max_m: float) -> Iterator[tuple[float, str, Any]]:
    """Yield the transform, the scan and the pose of each step with its time [s], and the map that it ends."""
    limits: dict[str, Any] = {
        "angle_min": float(log.angles[0]),
        "angle_max": float(log.angles[-1]),
        "angle_increment": float((log.angles[-1] - log.angles[0]) / (len(log.angles) - 1)),
        "time_increment": 0.0,
        "scan_time": float(np.median(np.diff(log.stamps))),
        "range_min": 0.0,
        "range_max": range_max_m,
        "intensities": np.zeros(0, np.float32),
    }
    predicted = next(maps, None)
    for stamp, ranges, (x, y, heading) in zip(log.stamps.tolist(), log.ranges, log.poses.tolist(), strict=True):
        time = TYPES["Time"](*divmod(round(stamp * 1e9), 10**9))
        in_map, in_laser = (TYPES["Header"](stamp=time, frame_id=frame) for frame in (MAP_FRAME, LASER_FRAME))
        turn = TYPES["Quaternion"](x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
        moved = TYPES["Transform"](translation=TYPES["Vector3"](x=x, y=y, z=0.0), rotation=turn)
        transform = TYPES["TransformStamped"](in_map, child_frame_id=LASER_FRAME, transform=moved)
        yield stamp, "/tf", TYPES["TFMessage"](transforms=[transform])
        yield stamp, "/scan", TYPES["LaserScan"](in_laser, ranges=ranges, **limits)
        pose = TYPES["Pose"](position=TYPES["Point"](x=x, y=y, z=0.0), orientation=turn)
        yield stamp, "/pose", TYPES["PoseStamped"](in_map, pose=pose)
        if predicted is not None and predicted.stamp == stamp:
            data = occupancy(predicted.free, predicted.unknown)
            yield stamp, "/predicted_map", grid_message(TYPES, data, predicted, time, MAP_FRAME)
            predicted = next(maps, None)
