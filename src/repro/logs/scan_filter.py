"""Scans of a lidar as they arrive, in logs and nodes: which can be used, and their valid readings at the same beams."""

import logging
import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from repro.logs.misses import MissCheck
from repro.logs.poses import MAX_PLACE_M
from repro.logs.readings import beams_of_turn, is_in_meters, readings
from repro.logs.times import WindowSettings
from repro.maps.validity import FULL_TURN
from repro.system.errors import InputError

LOGGER = logging.getLogger(__name__)
MAX_BEAMS = 20_000
MAX_RANGE_M = 10_000.0
FIRST_SCANS = 20  # of which the most frequent beams are those of the lidar
WITHOUT_POSE = "without a pose"
OTHER_BEAMS = ("with another number of beams", "with other beam angles")


@dataclass(frozen=True)
class LogScan:
    """One scan of a log or of a message.

    Args:
        stamp: time [s].
        ranges: ranges [m], (N,), see `readings`.
        first_angle: angle of the first beam in the frame of the lidar [rad].
        spacing: angle between two beams [rad], negative if they go clockwise.
        range_min_m: smallest valid range [m].
        range_max_m: smallest range that means a miss [m].
        pose: x, y [m] and heading [rad] of the lidar; None where it is unknown.
        problem: why it cannot be used, as its reader knows.
        header: that of the message, where it is needed later.
    """

    stamp: float
    ranges: np.ndarray
    first_angle: float
    spacing: float
    range_min_m: float
    range_max_m: float
    pose: tuple[float, float, float] | None
    problem: str | None = None
    header: Any = None

    @property
    def has_valid_range(self) -> bool:
        """Return whether the maximum range is positive and above the minimum, so that misses can be told."""
        return self.range_max_m > max(self.range_min_m, 0)  # false for NaN

    def has_beams_of(self, other: "LogScan") -> bool:
        """Return whether another scan has the same number of beams at the same angles."""
        angles, others = ((each.first_angle, each.spacing) for each in (self, other))
        return len(self.ranges) == len(other.ranges) and np.allclose(angles, others, atol=1e-4)

    def at_beams_of(self, other: "LogScan") -> "LogScan | None":
        """Return the scan at the beams of another one, each with the reading nearest in angle, NaN beyond the ends.

        None, unless both see the same field of view with a similar number of beams.
        """
        if self.has_beams_of(other):
            return self
        if len(self.ranges) < 2 or not 0.5 < self.spacing / other.spacing < 2:
            return None
        first, last = self.first_angle - other.first_angle, len(self.ranges) - 1
        end = first + self.spacing * last - other.spacing * (len(other.ranges) - 1)
        if max(abs(first), abs(end)) > 2 * abs(other.spacing):
            return None
        place = (other.first_angle + other.spacing * np.arange(len(other.ranges)) - self.first_angle) / self.spacing
        index = np.rint(place).astype(int)
        ranges = np.where((index >= 0) & (index <= last), self.ranges[index.clip(0, last)], np.nan).astype(np.float32)
        return replace(self, ranges=ranges, first_angle=other.first_angle, spacing=other.spacing)

    def in_order(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angles [rad], (N,), and the index, (N,), of the beams by increasing angle.

        The last beams of a full turn that point where the first ones do are left out.
        """
        index = np.arange(len(self.ranges))
        angles = self.first_angle + self.spacing * index
        if angles[-1] < angles[0]:
            angles, index = angles[::-1], index[::-1]
        count = beams_of_turn(angles)
        return angles[:count] - (2 * math.pi if angles[count - 1] > 2 * math.pi else 0), index[:count]


class Intake:
    """Takes the scans of a lidar one by one and passes on those that can be used, with valid ranges at the same beams.

    The beams and the maximum range are the most frequent ones of the first `FIRST_SCANS` scans with a pose, which wait
    for one another. A scan of the same field of view with another number of beams is resampled, one with another
    maximum range is left out. If most of them differ, the driver states no maximum range but, for example, the largest
    reading: the range is not known, and inf alone is a miss.

    Args:
        source: what the scans are from, for messages.
        settings: their maximum range replaces that of the scans, and they say what a miss is taken for.

    Attributes:
        angles: the angles of the beams [rad], (N,), increasing; empty before they are known.
        range_max_m: smallest range that means a miss [m].
        notes: what is wrong with the scans that were taken, by kind.
        left_out: number of scans that were left out, by reason.
        reasons: those of the scans that were left out by the last call.
    """

    def __init__(self, source: str, settings: WindowSettings) -> None:
        self.source, self.settings = source, settings
        self.angles, self.range_max_m = np.zeros(0), math.inf
        self.notes: dict[str, str] = {}
        self._misses = MissCheck()
        self.left_out: Counter[str] = Counter()
        self.reasons: list[str] = []
        self._first: LogScan | None = None
        self._index = np.zeros(0, dtype=int)
        self._waiting: list[LogScan] = []
        self._resampled = False

    def take(self, scan: LogScan) -> list[LogScan]:
        """Take a scan and return those that can be used from now on, in the order of their arrival.

        Raises:
            InputError: the first scans have no beams that a lidar can have.
        """
        self.reasons = []
        if self.settings.range_max_m is not None:
            scan = replace(scan, range_max_m=self.settings.range_max_m)
        elif scan.range_max_m > MAX_RANGE_M:  # of a driver that knows none
            scan = replace(scan, range_max_m=math.inf)
        if reason := _why_unplaced(scan):
            self._leave_out(reason)
            return []
        if self._first is not None:
            return self._usable([scan], self._first)
        self._waiting.append(scan)
        return self.flush() if len(self._waiting) >= FIRST_SCANS else []

    def flush(self) -> list[LogScan]:
        """Return the scans that can be used of those that still wait.

        Raises:
            InputError: they have no beams that a lidar can have.
        """
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return []
        good = [scan for scan in waiting if scan.has_valid_range] or waiting
        first = max(good, key=lambda scan: sum(scan.has_beams_of(other) for other in good))
        _check_beams(first, self.source)
        self._first, (self.angles, self._index) = first, first.in_order()
        self.range_max_m = self._usual_range(good)
        return self._usable(waiting, first)

    def _usual_range(self, scans: list[LogScan]) -> float:
        """Return the maximum range of most of the scans [m], inf if most differ from each other."""
        found = sorted(scan.range_max_m for scan in scans)
        usual = found[len(found) // 2]
        if 2 * sum(_is_near(each, usual) for each in found) > len(found):
            return usual
        self.notes["range"] = (
            f"the maximum range of the scans varies from {found[0]:.4g} to {found[-1]:.4g} m, as of a driver that "
            "states the largest reading: only inf is a miss; set range_max_m to that of the lidar [m]"
        )
        return math.inf

    def _usable(self, scans: list[LogScan], first: LogScan) -> list[LogScan]:
        """Return those of some scans that can be used, with valid ranges at the beams of the first one, in order."""
        found = []
        for scan in scans:
            resampled = scan.at_beams_of(first)
            if resampled is None:
                has_as_many = len(scan.ranges) == len(first.ranges)
                self._leave_out(OTHER_BEAMS[1] if has_as_many else f"{OTHER_BEAMS[0]} than {len(first.ranges)}")
            elif not scan.has_valid_range:
                self._leave_out("without a valid maximum range")
            elif not is_in_meters(scan.ranges):
                self._leave_out("with ranges that are not in meters")
            elif not (_is_near(scan.range_max_m, self.range_max_m) or math.isinf(self.range_max_m)):
                self._leave_out(f"with another maximum range than {self.range_max_m:.4g} m, which range_max_m replaces")
            elif np.isnan(ranges := self._valid(resampled)).all():
                self._leave_out("without a valid reading")
            else:
                self._say_resampled(scan, resampled)
                found.append(replace(resampled, ranges=ranges[self._index], range_max_m=self.range_max_m))
        return found

    def _valid(self, scan: LogScan) -> np.ndarray:
        """Return the ranges of a scan with inf for a miss and NaN for an invalid reading, and count the misses."""
        ranges = readings(scan.ranges, scan.range_min_m, self.range_max_m, self.settings.misses)
        assert scan.pose is not None, "others are left out"
        self._misses.add(scan.ranges, ranges, scan.pose[2], self.range_max_m)
        self.notes |= self._misses.notes
        return ranges

    def _say_resampled(self, scan: LogScan, resampled: LogScan) -> None:
        if resampled is not scan and not self._resampled:
            self._resampled = True
            count = len(resampled.ranges)
            LOGGER.warning(
                "%s: the beams vary, such as %d and %d: all scans are resampled to the most frequent, %d",
                *(self.source, count, len(scan.ranges), count),
            )

    def _leave_out(self, reason: str) -> None:
        self.left_out[reason] += 1
        self.reasons.append(reason)


def _is_near(range_m: float, other_m: float) -> bool:
    """Return whether two maximum ranges are that of one lidar, which is a constant."""
    return range_m == other_m or abs(range_m - other_m) <= 1e-4 * abs(other_m)


def _check_beams(scan: LogScan, source: str) -> None:
    """Refuse beams that a lidar does not have."""
    count, spacing = len(scan.ranges), scan.spacing
    if not 2 <= count <= MAX_BEAMS:
        raise InputError(f"{source}: expected scans of 2 to {MAX_BEAMS} beams, got {count}")
    if not abs(scan.first_angle) <= 2 * FULL_TURN or not 0 < abs(spacing) * (count - 1) <= FULL_TURN:
        raise InputError(
            f"{source}: expected beam angles in radians within one turn, got {count} beams from "
            f"{scan.first_angle:.4g} with a spacing of {spacing:.4g}"
        )
    if not scan.has_valid_range:
        raise InputError(
            f"{source}: expected a positive maximum range above the minimum, {scan.range_min_m:.4g} m, got "
            f"{scan.range_max_m:.4g}: set range_max_m to that of the lidar [m]"
        )


def _why_unplaced(scan: LogScan) -> str | None:
    """Return why a scan cannot tell the beams of the lidar; None if it can. Without a pose it may be upside down."""
    if scan.problem:
        return scan.problem
    if not math.isfinite(scan.stamp):
        return "without a time"
    if not len(scan.ranges):
        return "without beams"
    if scan.pose is None or not np.isfinite(scan.pose).all():
        return WITHOUT_POSE
    return None if np.abs(scan.pose[:2]).max() <= MAX_PLACE_M else f"with a pose farther than {MAX_PLACE_M:g} m"
