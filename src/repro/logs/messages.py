"""ROS messages to scans and poses, of rclpy or rosbags, which name the fields alike."""

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from repro.logs.distortion import undistorted
from repro.logs.log_scan import LogScan
from repro.logs.reasons import Reason
from repro.logs.transforms import Transforms
from repro.system.errors import InputError

GAPS = 15  # between scans, of which the median is taken
MAX_SCAN_S, LONGER = 1.0, 1.2  # duration of a scan, and how many times the time to the next one it may last
EXTRA_BEAMS = (-0.5, 1.5)  # from the last beam to angle_max, which some drivers set to the angle after it
MAX_VARIATION = 0.1  # of the number of readings between the scans of a lidar


def seconds(stamp: Any) -> float:
    """Return the time of a stamp [s]."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def add_transforms(transforms: Transforms, message: Any, *, is_static: bool = False) -> None:
    """Add the transforms of a TFMessage."""
    for transform in message.transforms:
        _add(transforms, transform, transform.transform.translation, transform.transform.rotation, is_static=is_static)


def add_odometry(transforms: Transforms, message: Any) -> None:
    """Add the pose of an Odometry message."""
    _add(transforms, message, message.pose.pose.position, message.pose.pose.orientation)


def add_pose(transforms: Transforms, message: Any, child: str) -> None:
    """Add a PoseStamped or PoseWithCovarianceStamped of a frame, which such a message does not name."""
    pose = getattr(message.pose, "pose", message.pose)
    place, turn = pose.position, pose.orientation
    quaternion, stamp = (turn.x, turn.y, turn.z, turn.w), seconds(message.header.stamp)
    transforms.add(child, message.header.frame_id, stamp, (place.x, place.y, place.z), quaternion)


def _add(transforms: Transforms, message: Any, place: Any, turn: Any, *, is_static: bool = False) -> None:
    stamp, child, parent = seconds(message.header.stamp), message.child_frame_id, message.header.frame_id
    quaternion = turn.x, turn.y, turn.z, turn.w
    transforms.add(child, parent, stamp, (place.x, place.y, place.z), quaternion, is_static=is_static)


class ScanTimes(NamedTuple):
    """The times of the first beam of a scan, of its middle, at which its pose is taken, and of the last [s]."""

    first_s: float
    middle_s: float
    last_s: float


class LaserScans:
    """Converts the LaserScan messages of a topic, in the order of their arrival, and warns once of each wrong field.

    Args:
        warn: is called with each message.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self.warn = warn
        self._gaps: deque[float] = deque(maxlen=GAPS)
        self._last_s = math.nan
        self._warned: set[str] = set()

    def times(self, message: Any) -> ScanTimes:
        """Return the times of a scan.

        Where a scan would last longer than the time to the next one, `time_increment` is wrong, and is ignored.
        """
        stamp = seconds(message.header.stamp)
        if stamp > self._last_s:
            self._gaps.append(stamp - self._last_s)
        self._last_s = stamp
        between_s = sorted(self._gaps)[len(self._gaps) // 2] if self._gaps else MAX_SCAN_S
        increment = float(message.time_increment)
        lasts_s = increment * (len(message.ranges) - 1)
        if lasts_s == 0 or (0 < lasts_s <= LONGER * min(between_s, MAX_SCAN_S)):
            return ScanTimes(stamp, stamp + lasts_s / 2, stamp + lasts_s)
        text = f"time_increment is {increment:.4g} s, with which a scan lasts {lasts_s:.3g} s, and one follows after "
        self.warn_once("time_increment", f"{text}{between_s:.3g} s: it is ignored")
        return ScanTimes(stamp, stamp, stamp)

    def convert(self, message: Any, times: ScanTimes, transforms: Transforms) -> LogScan:
        """Convert a scan, given what `times` returned, with the pose of its frame in its middle.

        Every beam is placed at its own time where the poses at the first and the last are known, too. The angles of a
        lidar that is mounted upside down are negated, so that they count counterclockwise on the map.
        """
        placed, problem, frame = None, None, message.header.frame_id
        try:
            placed = transforms.pose_at(frame, times.middle_s)
            moves = placed is not None and times.first_s < times.last_s
            begin, end = (
                transforms.pose_at(frame, stamp) if moves else None for stamp in (times.first_s, times.last_s)
            )
        except InputError as error:
            self.warn_once("tilt", str(error))
            placed, begin, end = None, None, None
            problem = Reason.TILTED
        first, spacing, contradiction = self._angles(message)
        sense = -1 if placed and placed.is_upside_down else 1
        scan = LogScan(
            stamp=times.first_s,
            ranges=np.asarray(message.ranges, dtype=np.float32),
            first_angle=sense * first,
            spacing=sense * spacing,
            range_min_m=float(message.range_min),
            range_max_m=float(message.range_max),
            pose=(placed.x, placed.y, placed.heading) if placed else None,
            problem=problem or contradiction,
            header=message.header,
        )
        is_usable = begin and end and not scan.problem and math.isfinite(first + spacing)
        return undistorted(scan, begin, end) if is_usable and begin and end else scan

    def _angles(self, message: Any) -> tuple[float, float, Reason | None]:
        """Return the first angle and the angle between beams [rad], and a contradiction of the fields, if any."""
        first, last, spacing = (float(getattr(message, f"angle_{name}")) for name in ("min", "max", "increment"))
        steps = len(message.ranges) - 1
        if steps < 1 or not math.isfinite(last) or last == first:
            return first, spacing, None
        by_limits = (last - first) / steps
        if not math.isfinite(spacing) or spacing == 0:
            return first, spacing, Reason.CONTRADICTION
        if EXTRA_BEAMS[0] <= (last - first) / spacing - steps <= EXTRA_BEAMS[1]:
            return first, spacing, None
        text = (
            f"{steps + 1} readings from angle_min {first:.4g} with angle_increment {spacing:.4g} end at "
            f"{first + steps * spacing:.4g}, angle_max is {last:.4g}"
        )
        if abs(by_limits - spacing) <= MAX_VARIATION * abs(spacing):  # rounded, or the number of readings varies
            self.warn_once("angles", f"{text}: they are spread over the field of view")
            return first, by_limits, None
        self.warn_once("angles", text)
        return first, spacing, Reason.CONTRADICTION

    def warn_once(self, kind: str, message: str) -> None:
        """Warn of something, unless a message of its kind was given before."""
        if kind not in self._warned:
            self._warned.add(kind)
            self.warn(message)
