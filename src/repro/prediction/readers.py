"""Readers of logs, chosen by the content of the file: our npz, CARMEN (plain or gzipped), ROS 1 and ROS 2 bags, MCAP.

CARMEN: http://carmen.sourceforge.net/program_carmen/logger.html ("FLASER", "ROBOTLASER1", "PARAM").
"""

import gzip
import math
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from repro.prediction.arrays import ARRAYS, RANGE_MAX, read_arrays
from repro.prediction.logs import ScanLog, collect
from repro.prediction.readings import LogScan
from repro.system.errors import InputError

KINDS = "an npz with ranges, angles, poses and stamps, a CARMEN log, or a ROS 1, ROS 2 or MCAP bag"
CARMEN_MAX_M = 81.83  # of the SICK LMS 200 in its longest setting, where a log does not say
CARMEN_WORDS = ("FLASER", "ROBOTLASER1", "PARAM", "ODOM", "RLASER", "SYNC", "TRUEPOS", "NMEAGGA", "# CARMEN")


def read_log(path: Path, spacing_s: float, topics: tuple[str | None, str | None] = (None, None)) -> ScanLog:
    """Read a log.

    Args:
        path: a file, or the directory of a ROS 2 bag.
        spacing_s: smallest time between two scans that are kept [s].
        topics: topics of the scans and of the odometry in a bag; None to find them.

    Raises:
        ValueError: the file is missing, unreadable, empty, damaged or of another kind, or holds no usable scans; the
            message names it and what was expected.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file: expected {KINDS}")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise InputError(f"{path}: is a directory without metadata.yaml: expected {KINDS}")
        return _read_bag(path, spacing_s, topics)
    if not path.is_file():
        raise InputError(f"{path}: is neither a file nor a directory: expected {KINDS}")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): expected {KINDS}") from error
    if not head:
        raise InputError(f"{path}: is empty: expected {KINDS}")
    if head.startswith((b"#ROSBAG V2.0", b"\x89MCAP", b"SQLite format 3")):
        return _read_bag(path, spacing_s, topics)
    if head.startswith(b"PK"):
        return collect(_npz_scans(path), path, spacing_s)
    is_gzip = head.startswith(b"\x1f\x8b")
    if not is_gzip and not _is_carmen(head):
        raise InputError(f"{path}: is of no known kind: expected {KINDS}")
    try:
        with (
            gzip.open(path, "rt", encoding="utf-8-sig", errors="replace")
            if is_gzip
            else path.open(encoding="utf-8-sig", errors="replace") as lines
        ):
            return collect(carmen_scans(lines, path), path, spacing_s)
    except (gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise InputError(f"{path}: is damaged ({error})") from error


def _is_carmen(head: bytes) -> bool:
    if b"\0" in head:
        return False
    lines = head.decode("utf-8-sig", "replace").splitlines()
    return any(line.startswith(CARMEN_WORDS) for line in lines)


def _npz_scans(path: Path) -> Iterator[LogScan]:
    content = read_arrays(path)
    ranges, angles, poses, stamps = (content[name] for name in ARRAYS)
    range_max_m = float(content[RANGE_MAX])
    shapes = [array.shape for array in (ranges, angles, poses, stamps)]
    if ranges.ndim != 2 or shapes[1:] != [ranges.shape[1:], (len(ranges), 3), (len(ranges),)]:
        raise InputError(f"{path}: expected ranges (S, N), angles (N,), poses (S, 3), stamps (S,), got {shapes}")
    gaps = np.diff(angles)
    if not len(gaps) or not np.isfinite(gaps).all() or np.abs(gaps - gaps.mean()).max() > 0.01 * abs(gaps.mean()):
        raise InputError(f"{path}: the beam angles are not evenly spaced: resample the scans first")
    for stamp, scan, pose in zip(stamps, ranges, poses, strict=True):
        x, y, heading = pose
        yield LogScan(stamp, scan, float(angles[0]), float(gaps.mean()), 0.0, range_max_m, (x, y, heading))


def carmen_scans(lines: Iterator[str], path: Path) -> Iterator[LogScan]:
    """Read the scans of the front lidar from the lines of a CARMEN log.

    Raises:
        ValueError: a line does not follow the format; the message has its number.
    """
    range_max_m = None
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if (
                words[:1] == ["PARAM"]
                and words[1:2]
                and words[1].endswith(("front_laser_max", "laser_front_max_range"))
            ):
                range_max_m = float(words[2])
            elif words[:1] == ["FLASER"]:
                if range_max_m is None:
                    range_max_m = CARMEN_MAX_M
                    print(
                        f"{path}: it states no maximum range before its first scan: {CARMEN_MAX_M} m is taken, "
                        "prediction.range_max_m=... chooses another",
                        flush=True,
                    )
                yield _flaser(words, range_max_m)
            elif words[:1] == ["ROBOTLASER1"]:
                yield _robotlaser(words)
        except (ValueError, IndexError) as error:
            raise InputError(f"{path}: line {number} is no {words[0]} line of CARMEN ({error})") from error


def _flaser(words: list[str], range_max_m: float) -> LogScan:
    """Read FLASER num_readings [ranges] x y theta odom_x odom_y odom_theta ipc_timestamp ipc_hostname timestamp."""
    count = int(words[1])
    ranges, rest = _floats(words[2 : 2 + count], count), words[2 + count :]
    x, y, heading = _floats(rest[:3], 3)
    spacing = math.radians({181: 1, 360: 0.5, 361: 0.5, 540: 0.5, 541: 0.5}.get(count, 180 / max(count, 1)))
    return LogScan(float(rest[6]), ranges, -spacing * (count // 2), spacing, 0.0, range_max_m, (x, y, heading))


def _robotlaser(words: list[str]) -> LogScan:
    """Read ROBOTLASER1 type start_angle fov resolution maximum_range accuracy remission_mode num_readings [ranges]
    num_remissions [remissions] laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward_safety_dist
    side_safety_dist turn_axis timestamp hostname logger_timestamp.
    """
    first, _, spacing, range_max_m = _floats(words[2:6], 4)
    count = int(words[8])
    ranges, rest = _floats(words[9 : 9 + count], count), words[9 + count :]
    rest = rest[1 + int(rest[0]) :]
    x, y, heading = _floats(rest[:3], 3)
    return LogScan(float(rest[11]), ranges, float(first), float(spacing), 0.0, float(range_max_m), (x, y, heading))


def _floats(words: list[str], count: int) -> np.ndarray:
    if len(words) != count:
        raise InputError(f"expected {count} numbers, got {len(words)}")
    return np.array(words, dtype=float)


def _read_bag(path: Path, spacing_s: float, topics: tuple[str | None, str | None]) -> ScanLog:
    try:
        from repro.prediction.bags import bag_scans
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: reading a bag needs the package rosbags: pip install rosbags") from error
    return collect(bag_scans(path, *topics), path, spacing_s)
