"""Scans of the front lidar from CARMEN logs: http://carmen.sourceforge.net/program_carmen/logger.html."""

import gzip
import logging
import math
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from repro.logs.log_scan import LogScan
from repro.logs.poses import MAX_GAP_S
from repro.logs.reasons import Reason
from repro.scans import wrapped
from repro.system.errors import InputError

LOGGER = logging.getLogger(__name__)
RANGE_MAX_M = 81.83  # of the SICK LMS 200 in its longest setting, where a log does not say
FLASER_SPACING_DEG = {101: 1, 180: 1, 181: 1, 201: 0.5, 360: 0.5, 361: 0.5, 401: 0.25, 540: 0.5, 541: 0.5}  # by count
PLACED = {"FLASER", "ROBOTLASER1"}  # lines of scans with the pose of the lidar
WORDS = (*PLACED, "RAWLASER1", "PARAM", "ODOM", "RLASER", "SYNC", "TRUEPOS", "NMEAGGA", "# CARMEN")
GZIP = b"\x1f\x8b"  # the first bytes of a gzipped file
MAX_LINE, MAX_WORD = 4_000_000, 20  # characters of a line of many readings, and of a word in a message
OFFSET_NAMES = ("frontlaser_offset", "front_laser_offset")
RANGE_NAMES = ("front_laser_max", "laser_front_max_range")  # ends of the names of a parameter


def is_carmen(head: bytes) -> bool:
    """Return whether a file that begins with some bytes is a CARMEN log."""
    if b"\0" in head:
        return False
    lines = head.decode("utf-8-sig", "replace").splitlines()
    return any(line.startswith(WORDS) for line in lines)


def read_carmen(path: Path) -> Iterator[LogScan]:
    """Read the scans of a file, plain or gzipped.

    Raises:
        InputError: it is damaged, has a line that does not follow the format, or no line of a lidar.
    """
    with path.open("rb") as file:
        opener = gzip.open if file.read(2) == GZIP else open
    try:
        with opener(path, "rt", encoding="utf-8-sig", errors="replace") as lines:
            yield from carmen_scans(iter(partial(lines.readline, MAX_LINE), ""), path)
    except (gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise InputError(f"{path}: is damaged ({error})") from error


def carmen_scans(lines: Iterable[str], path: Path) -> Iterator[LogScan]:
    """Read the scans of the front lidar from the lines of a CARMEN log.

    Scans without a pose, `RAWLASER1`, are placed by the odometry around them, unless the log has placed ones, too.

    Raises:
        InputError: a line does not follow the format, and the message has its number; or none is of a lidar.
    """
    range_max_m, found, odometry = None, set[str](), _Odometry()
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if len(line) >= MAX_LINE:
                raise InputError(f"it has {MAX_LINE:,} characters or more")
            if words[:1] == ["PARAM"] and words[1:] and words[1].endswith(RANGE_NAMES):
                range_max_m = float(words[2])
            elif words[:1] == ["PARAM"] and words[1:] and words[1].endswith(OFFSET_NAMES):
                odometry.ahead_m = float(words[2])
            elif words[:1] == ["FLASER"]:
                if range_max_m is None:
                    range_max_m = RANGE_MAX_M
                    LOGGER.warning(
                        "%s: it states no maximum range before its first scan: %s m is taken, "
                        "prediction.range_max_m=... chooses another",
                        *(path, RANGE_MAX_M),
                    )
                yield _flaser(words, range_max_m)
            elif words[:1] == ["ROBOTLASER1"]:
                yield _robotlaser(words)
            elif words[:1] == ["RAWLASER1"] and not found & PLACED:
                odometry.waiting.append(_rawlaser(words))
            elif words[:1] == ["ODOM"]:
                yield from odometry.add(float(words[7]), _pose(words[1:4]))
            found.update(word for word in words[:1] if word in WORDS)
        except (ValueError, IndexError) as error:
            name = words[0][:MAX_WORD] if words else "blank"
            raise InputError(f"{path}: line {number} is no {name} line of CARMEN ({error})") from error
    yield from odometry.waiting
    if not found & {*PLACED, "RAWLASER1"}:
        known = f"its lines are {', '.join(sorted(found))}" if found else "it has none of its words"
        raise InputError(f"{path}: expected lines FLASER, ROBOTLASER1 or RAWLASER1 of a CARMEN log; {known}")


class _Odometry:
    """Places scans by the odometry before and after them.

    Attributes:
        ahead_m: place of the lidar in front of the robot [m].
        waiting: scans that wait for the odometry after them.
    """

    def __init__(self) -> None:
        self.ahead_m = 0.0
        self.waiting: list[LogScan] = []
        self._last_s, self._last = math.nan, (math.nan, math.nan, math.nan)

    def add(self, stamp: float, pose: tuple[float, float, float]) -> Iterator[LogScan]:
        """Take a pose of the robot, and yield the scans that wait, placed unless it is the first or follows a gap."""
        for scan in self.waiting:
            if not stamp - self._last_s <= MAX_GAP_S:  # also of times that are not finite
                yield scan
                continue
            share = (scan.stamp - self._last_s) / (stamp - self._last_s) if stamp > self._last_s else 1.0
            x, y, heading = (one + min(max(share, 0), 1) * (other - one) for one, other in self._between(pose))
            place = x + self.ahead_m * math.cos(heading), y + self.ahead_m * math.sin(heading), heading
            yield replace(scan, pose=place)
        self.waiting, self._last_s, self._last = [], stamp, pose

    def _between(self, pose: tuple[float, float, float]) -> Iterator[tuple[float, float]]:
        """Yield the coordinates of the last pose and of this one, whose heading is next to the last one."""
        turn = float(wrapped(pose[2] - self._last[2]))
        return zip(self._last, (*pose[:2], self._last[2] + turn), strict=True)


def _flaser(words: list[str], range_max_m: float) -> LogScan:
    """Read FLASER num_readings [ranges] x y theta odom_x odom_y odom_theta ipc_timestamp ipc_hostname timestamp."""
    count = int(words[1])
    ranges, rest = _floats(words[2 : 2 + count], count), words[2 + count :]
    problem = None if count in FLASER_SPACING_DEG or not count else Reason.UNKNOWN_ANGLES
    spacing = math.radians(FLASER_SPACING_DEG.get(count, 1))
    first = -spacing * (count // 2)
    return LogScan(float(rest[6]), ranges, first, spacing, 0.0, range_max_m, _pose(rest[:3]), problem)


def _robotlaser(words: list[str]) -> LogScan:
    """Read ROBOTLASER1 type start_angle fov resolution maximum_range accuracy remission_mode num_readings [ranges]
    num_remissions [remissions] laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward_safety_dist
    side_safety_dist turn_axis timestamp hostname logger_timestamp.
    """
    first, view, spacing, range_max_m = _floats(words[2:6], 4).tolist()
    count = int(words[8])
    ranges, rest = _floats(words[9 : 9 + count], count), words[9 + count :]
    rest = rest[1 + int(rest[0]) :]
    is_consistent = not count > 1 or not view > 0 or abs(spacing * (count - 1) - view) <= 1.5 * spacing + 0.01 * view
    problem = None if is_consistent else Reason.CONTRADICTION
    return LogScan(float(rest[11]), ranges, first, spacing, 0.0, range_max_m, _pose(rest[:3]), problem)


def _rawlaser(words: list[str]) -> LogScan:
    """Read RAWLASER1 type start_angle fov resolution maximum_range accuracy remission_mode num_readings [ranges]
    num_remissions [remissions] timestamp hostname logger_timestamp.
    """
    first, _, spacing, range_max_m = _floats(words[2:6], 4).tolist()
    count = int(words[8])
    ranges, rest = _floats(words[9 : 9 + count], count), words[9 + count :]
    return LogScan(float(rest[1 + int(rest[0])]), ranges, first, spacing, 0.0, range_max_m, None)


def _pose(words: list[str]) -> tuple[float, float, float]:
    x, y, heading = _floats(words, 3).tolist()
    return x, y, heading


def _floats(words: list[str], count: int) -> np.ndarray:
    if len(words) != count:
        raise InputError(f"expected {count} numbers, got {len(words)}")
    return np.array(words, dtype=float)
