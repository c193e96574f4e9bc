"""Which scans of a lidar can be used, in logs and nodes, as they arrive, with valid readings at the same beams."""

import logging
import math
from collections import Counter
from dataclasses import replace

import numpy as np

from repro.logs.log_scan import LogScan
from repro.logs.misses import MissCheck
from repro.logs.options import MAX_RANGE_M, WindowSettings
from repro.logs.poses import MAX_PLACE_M
from repro.logs.readings import is_in_meters, readings
from repro.logs.reasons import Reason
from repro.maps.validity import FULL_TURN
from repro.system.errors import InputError

LOGGER = logging.getLogger(__name__)
MAX_BEAMS = 20_000
FIRST_SCANS = 20  # of which the most frequent beams are those of the lidar


class ScanFilter:
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
        self.left_out: Counter[Reason] = Counter()
        self.reasons: list[Reason] = []
        self._first: LogScan | None = None
        self._index = np.zeros(0, dtype=int)
        self._waiting: list[LogScan] = []
        self._resampled = False

    def add(self, scan: LogScan) -> list[LogScan]:
        """Take a scan, and return those that can be used from now on, in the order of their arrival.

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
        if 2 * sum(_is_near(range_max_m, usual) for range_max_m in found) > len(found):
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
                self._leave_out(Reason.OTHER_ANGLES if has_as_many else Reason.OTHER_BEAMS)
            elif not scan.has_valid_range:
                self._leave_out(Reason.NO_RANGE)
            elif not is_in_meters(scan.ranges):
                self._leave_out(Reason.NOT_METERS)
            elif not (_is_near(scan.range_max_m, self.range_max_m) or math.isinf(self.range_max_m)):
                self._leave_out(Reason.OTHER_RANGE)
            elif np.isnan(ranges := self._valid(resampled)).all():
                self._leave_out(Reason.NO_READING)
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

    def _leave_out(self, reason: Reason) -> None:
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


def _why_unplaced(scan: LogScan) -> Reason | None:
    """Return why a scan cannot tell the beams of the lidar; None if it can. Without a pose it may be upside down."""
    if scan.problem:
        return scan.problem
    if not math.isfinite(scan.stamp):
        return Reason.NO_TIME
    if not len(scan.ranges):
        return Reason.NO_BEAMS
    if scan.pose is None or not np.isfinite(scan.pose).all():
        return Reason.NO_POSE
    return None if np.abs(scan.pose[:2]).max() <= MAX_PLACE_M else Reason.FAR_POSE
