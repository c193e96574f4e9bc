"""A log in every format, written by other code than the readers."""

import math
from pathlib import Path

import numpy as np
import pytest
from messages import Ros
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from repro.logs.formats import read_log
from repro.logs.options import ReadOptions, WindowSettings
from repro.logs.scan_log import ScanLog

SCANS, BEAMS = 30, 181
WINDOWS = WindowSettings(steps=10)
STAMPS = 100 + 0.1 * np.arange(SCANS)
POSES = np.stack([0.05 * np.arange(SCANS), -0.02 * np.arange(SCANS), 0.03 * np.arange(SCANS)], axis=-1)
RANGES = 2 + np.random.default_rng(0).random((SCANS, BEAMS)).round(2)
RANGES[:, 40] = 81.83  # a miss
SPACING = math.radians(1)
ANGLES = np.radians(np.arange(-90, 91))


def expect(log: ScanLog, *, atol: float = 1e-6) -> None:
    """Assert that a log is the one above."""
    assert log.stamps == pytest.approx(STAMPS, abs=1e-6)
    assert np.isinf(log.ranges[:, 40]).all()
    hits = np.delete(log.ranges, 40, axis=1)
    assert hits == pytest.approx(np.delete(RANGES, 40, axis=1), abs=1e-5)
    assert log.angles == pytest.approx(ANGLES, abs=1e-5)
    assert log.poses == pytest.approx(POSES, abs=atol)
    assert log.skipped == {}


def flaser(number: int, ranges=None) -> str:
    x, y, heading = POSES[number]
    readings = RANGES[number] if ranges is None else ranges
    words = " ".join(f"{value:.2f}" for value in readings)
    pose = f"{x:.6f} {y:.6f} {heading:.6f}"
    return f"FLASER {len(readings)} {words} {pose} {pose} {STAMPS[number]:.6f} robot {number:.3f}"


def robotlaser(number: int) -> str:
    words = " ".join(f"{value:.2f}" for value in RANGES[number])
    x, y, heading = POSES[number]
    pose = f"{x:.6f} {y:.6f} {heading:.6f}"
    return (
        f"ROBOTLASER1 0 {-math.pi / 2:.8f} {math.pi:.8f} {SPACING:.8f} 81.83 0.01 0 {BEAMS} {words} 2 0.5 0.5 "
        f"{pose} {pose} 0.0 0.0 0.3 0.3 1000000 {STAMPS[number]:.6f} robot {number:.3f}"
    )


def lines(line=flaser, changed: dict[int, str] | None = None) -> list[str]:
    """Return the lines of the scans, of which some are others."""
    return [(changed or {}).get(number, line(number)) for number in range(SCANS)]


def carmen(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(["# CARMEN Logfile", "PARAM robot_front_laser_max 81.83", *lines, ""]))
    return path


def npz(path: Path, **changes) -> Path:
    """Write the log as arrays, of which some are others, and none where they are None."""
    arrays = {"ranges": RANGES, "angles": ANGLES, "poses": POSES, "stamps": STAMPS} | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def read(path: Path, settings: WindowSettings = WINDOWS, **options) -> ScanLog:
    return read_log(path, settings, ReadOptions(**options))


def bag(
    path: Path,
    version: int,
    *,
    poses: str,
    storage=StoragePlugin.MCAP,
    scans: int = SCANS,
    compression=(),
    is_mounted: bool = True,
) -> Path:
    """Write a bag with the writers of rosbags; the lidar is 0.2 m in front of the robot where there are transforms."""
    ros = Ros(version)
    made = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=storage)
    if compression:
        made.set_compression(*compression)
    with made as writer:
        topics: dict[str, object] = {}

        def write(topic: str, stamp: float, message) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=ros.store)
            writer.write(topics[topic], round(stamp * 1e9), ros.serialized(message))

        if is_mounted:
            ahead = 0.2 * (poses in ("tf", "both"))
            write("/tf_static", STAMPS[0], ros.transform(STAMPS[0], "base_link", "laser", (ahead, 0, 0)))
        if poses == "conflict":
            write("/tf_static", STAMPS[0], ros.transform(STAMPS[0], "base_footprint", "base_link", (0, 0, 0)))
        for step in range(-1, scans + 1):  # poses at other times than the scans, linear in between
            stamp = 100 + 0.1 * step + 0.04
            x, y, heading = (rate * (step + 0.4) for rate in (0.05, -0.02, 0.03))
            if poses in ("tf", "both"):
                x, y = x - 0.2 * math.cos(heading), y - 0.2 * math.sin(heading)
                drift = 5.0 if poses == "both" else 0.0  # of a localization that is to be replaced by odometry
                write("/tf", stamp, ros.transform(stamp, "odom", "base_link", (x + drift, y, heading)))
            if poses in ("odometry", "both", "conflict"):
                write("/odom", stamp, ros.odometry(stamp, (x, y, heading), "base_link"))
        for step in range(scans):
            limits = {"angle_increment": float(np.float32(SPACING)), "range_min": 0.05, "range_max": 81.0}
            write("/scan", STAMPS[step], ros.scan(STAMPS[step], ANGLES, RANGES[step], **limits))
    return path
