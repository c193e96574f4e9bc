"""Scans of a lidar as they arrive, in logs and nodes: which can be used, and their readings at the same beams."""

import logging
import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from repro.prediction.readings import beams_of_turn, check_turn, readings
from repro.system.errors import InputError

LOGGER = logging.getLogger(__name__)
MAX_BEAMS = 100_000
FIRST_SCANS = 20  # of which the most frequent beams are those of the lidar
WITHOUT_BEAMS, WITHOUT_POSE = "without beams", "without a pose"
WITHOUT_RANGE = "without a valid maximum range"
OTHER_BEAMS = ("with another number of beams", "with other beam angles")
WITHOUT_READING = "without a valid reading"


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
        source: the message, where it is needed later.
    """

    stamp: float
    ranges: np.ndarray
    first_angle: float
    spacing: float
    range_min_m: float
    range_max_m: float
    pose: tuple[float, float, float] | None
    problem: str | None = None
    source: Any = None

    @property
    def last_angle(self) -> float:
        """Return the angle of the last beam [rad]."""
        return self.first_angle + self.spacing * (len(self.ranges) - 1)

    @property
    def has_valid_range(self) -> bool:
        """Return whether the maximum range is positive and above the minimum, so that misses can be told."""
        return self.range_max_m > max(self.range_min_m, 0)  # false for NaN

    def has_beams_of(self, other: "LogScan") -> bool:
        """Return whether another scan has the same number of beams at the same angles."""
        angles, others = ((each.first_angle, each.spacing) for each in (self, other))
        return len(self.ranges) == len(other.ranges) and np.allclose(angles, others, atol=1e-4)

    def spans_view_of(self, other: "LogScan") -> bool:
        """Return whether another scan sees the same field of view with another number of beams."""
        if len(self.ranges) < 2 or not 0.5 < self.spacing / other.spacing < 2:
            return False
        ends = (self.first_angle - other.first_angle, self.last_angle - other.last_angle)
        return max(map(abs, ends)) <= 2 * abs(other.spacing)

    def at_beams_of(self, other: "LogScan") -> "LogScan":
        """Return the scan at the beams of another one, each with the reading nearest in angle, NaN beyond the ends."""
        if self.has_beams_of(other):
            return self
        place = (other.first_angle + other.spacing * np.arange(len(other.ranges)) - self.first_angle) / self.spacing
        index = np.rint(place).astype(int)
        is_seen = (index >= 0) & (index < len(self.ranges))
        ranges = np.where(is_seen, self.ranges[index.clip(0, len(self.ranges) - 1)], np.nan).astype(np.float32)
        return replace(self, ranges=ranges, first_angle=other.first_angle, spacing=other.spacing)


class Intake:
    """Takes the scans of a lidar one by one and passes on those that can be used, all with the same beams.

    The beams are the most frequent ones of the first `FIRST_SCANS` scans with a pose, which wait for one another. A
    scan of the same field of view with another number of beams is resampled.

    Args:
        source: what the scans are from, for messages.
        range_max_m: maximum range [m] that replaces that of the scans; None keeps it.

    Attributes:
        first: the scan whose beams are taken; None before they are known.
        left_out: number of scans that were left out, by reason.
        reasons: those of the scans that were left out by the last call.
    """

    def __init__(self, source: str, range_max_m: float | None = None) -> None:
        self.source, self.range_max_m = source, range_max_m
        self.first: LogScan | None = None
        self.left_out: Counter[str] = Counter()
        self.reasons: list[str] = []
        self._waiting: list[LogScan] = []
        self._resampled = False

    def take(self, scan: LogScan) -> list[LogScan]:
        """Take a scan and return those that can be used from now on, in the order of their arrival.

        Raises:
            InputError: the first scans have no beams that a lidar can have.
        """
        self.reasons = []
        if self.range_max_m is not None:
            scan = replace(scan, range_max_m=self.range_max_m)
        if reason := _why_unplaced(scan):
            self._leave_out(reason)
            return []
        if self.first is not None:
            return self._usable([scan])
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
        first = _most_frequent(waiting)
        check_beams(first, self.source)
        self.first = first
        return self._usable(waiting)

    def _usable(self, scans: list[LogScan]) -> list[LogScan]:
        assert self.first is not None, "known"
        found = []
        for scan in scans:
            if reason := _why_unusable(scan, self.first):
                self._leave_out(reason)
                continue
            resampled = scan.at_beams_of(self.first)
            if resampled is not scan and not self._resampled:
                self._resampled = True
                LOGGER.warning(
                    "%s: the beams vary, such as %d and %d: all scans are resampled to the most frequent, %d",
                    *(self.source, len(self.first.ranges), len(scan.ranges), len(self.first.ranges)),
                )
            found.append(resampled)
        return found

    def _leave_out(self, reason: str) -> None:
        self.left_out[reason] += 1
        self.reasons.append(reason)


def valid_ranges(scan: LogScan) -> np.ndarray:
    """Return the ranges of a scan with inf for a miss and NaN for an invalid reading, see `readings`."""
    return readings(scan.ranges, scan.range_min_m, scan.range_max_m)


def check_beams(scan: LogScan, source: str) -> None:
    """Check the beams of a scan.

    Raises:
        InputError: they are not those of a lidar; the message begins with the source of the scan.
    """
    if not 2 <= len(scan.ranges) <= MAX_BEAMS:
        raise InputError(f"{source}: expected scans of 2 to {MAX_BEAMS} beams, got {len(scan.ranges)}")
    check_turn(len(scan.ranges), scan.first_angle, scan.spacing, source)
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
        return WITHOUT_BEAMS
    if scan.pose is None or not np.isfinite(scan.pose).all():
        return WITHOUT_POSE
    return None


def _why_unusable(scan: LogScan, first: LogScan) -> str | None:
    """Return why a scan cannot be used with the beams of the first one; None if it can."""
    if not scan.has_beams_of(first) and not scan.spans_view_of(first):
        if len(scan.ranges) != len(first.ranges):
            return f"{OTHER_BEAMS[0]} than {len(first.ranges)}"
        return OTHER_BEAMS[1]
    if not scan.has_valid_range:
        return WITHOUT_RANGE
    if np.isnan(valid_ranges(scan)).all():
        return WITHOUT_READING
    return None


def is_other_beams(reason: str) -> bool:
    """Return whether a scan was left out because the lidar has other beams than before."""
    return reason.startswith(OTHER_BEAMS)


def _most_frequent(scans: list[LogScan]) -> LogScan:
    """Return the first of the scans with the most frequent beams, if possible one with a valid maximum range."""
    scans = [scan for scan in scans if scan.has_valid_range] or scans
    return max(scans, key=lambda scan: sum(scan.has_beams_of(other) for other in scans))


def in_order(scan: LogScan) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles [rad], (N,), and the index, (N,), of the beams of a scan by increasing angle.

    The last beams of a full turn that point where the first ones do are left out.
    """
    index = np.arange(len(scan.ranges))
    angles = scan.first_angle + scan.spacing * index
    if angles[-1] < angles[0]:
        angles, index = angles[::-1], index[::-1]
    count = beams_of_turn(angles)
    angles, index = angles[:count], index[:count]
    return (angles - 2 * math.pi if angles[-1] > 2 * math.pi else angles.copy()), index
