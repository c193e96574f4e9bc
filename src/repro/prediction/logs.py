"""A log of a robot: scans with their times and poses, checked scan by scan; what cannot be used is counted."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from repro.maps.validity import DEGREES, MAX_HEADING

MAX_BEAMS = 100_000
MIN_SCANS = 2
NOT_LATER, MOSTLY = "not later than the one before", 10  # some logs have times of six digits, which hardly increase
SET_BACK_S, SET_BACK = 10.0, "before or after the clock was set back"  # a time earlier than the last one by more
HEAD = 20  # scans of which most have the beams of the log
MILLIMETERS = 300.0  # median range [m] beyond which no 2D lidar measures; the readings are in other units


@dataclass(frozen=True)
class LogScan:
    """One scan of a log.

    Args:
        stamp: time [s].
        ranges: ranges [m], (N,), see `valid_ranges`.
        first_angle: angle of the first beam in the frame of the lidar [rad].
        spacing: angle between two beams [rad], negative if they go clockwise.
        range_min_m: smallest valid range [m].
        range_max_m: smallest range that means a miss [m].
        pose: x, y [m] and heading [rad] of the lidar; None where it is unknown.
    """

    stamp: float
    ranges: np.ndarray
    first_angle: float
    spacing: float
    range_min_m: float
    range_max_m: float
    pose: tuple[float, float, float] | None


@dataclass(frozen=True)
class ScanLog:
    """The usable scans of a log, in the order of time.

    Args:
        stamps: times [s], (S,), increasing.
        ranges: ranges [m], (S, N), float32; a miss is inf, an invalid reading NaN.
        angles: beam angles in the frame of the lidar [rad], (N,), increasing.
        poses: x, y [m] and heading [rad] of the lidar, (S, 3).
        skipped: number of scans that were left out, by reason.
        range_max_m: smallest range that means a miss [m].
    """

    stamps: np.ndarray
    ranges: np.ndarray
    angles: np.ndarray
    poses: np.ndarray
    skipped: dict[str, int] = field(default_factory=dict)
    range_max_m: float = math.inf

    def __len__(self) -> int:
        return len(self.stamps)

    def with_range(self, range_max_m: float) -> "ScanLog":
        """Return the log of a lidar with this maximum range [m], from which on a reading is a miss."""
        return replace(self, ranges=readings(self.ranges, 0.0, range_max_m), range_max_m=range_max_m)

    def crop(self, fov_rad: float) -> "ScanLog":
        """Return the log with the beams within a field of view around straight ahead.

        Raises:
            ValueError: fewer than two beams are within it.
        """
        ahead = (self.angles + math.pi) % (2 * math.pi) - math.pi  # a lidar may count its angles from 0 to a full turn
        inside = np.flatnonzero(np.abs(ahead) <= fov_rad / 2 + 1e-6)
        if len(inside) < 2:
            raise ValueError(f"{len(inside)} beams are within {math.degrees(fov_rad):.1f} degrees: use a larger one")
        inside = inside[np.argsort(ahead[inside])]
        return replace(self, ranges=np.ascontiguousarray(self.ranges[:, inside]), angles=ahead[inside])


def collect(scans: Iterable[LogScan], path: Path, spacing_s: float) -> ScanLog:
    """Check the scans of a log one by one and keep those that can be used.

    A scan is skipped if its time is not after that of the last one, or after it by less than `spacing_s`, if it has no
    pose, no valid reading, or other beams than most of the first ones. If the clock was set back, the longest part of
    the log without such a jump is kept.

    Args:
        scans: the scans in the order of the file.
        path: the file, for messages.
        spacing_s: smallest time between two scans that are kept [s].

    Raises:
        ValueError: no two scans can be used, the beams are not those of a lidar, the ranges are not meters, or the
            headings are not radians.
    """
    skipped: Counter[str] = Counter()
    usable = _usable(scans, path, spacing_s, skipped)
    first = next(usable, None)
    count = len(first.ranges) if first else 0
    kind = np.dtype([("stamp", "f8"), ("ranges", "f4", (count,)), ("pose", "f8", (3,))])
    rows = ((scan.stamp, valid_ranges(scan), scan.pose) for scan in chain([first] if first else [], usable))
    kept = np.fromiter(rows, kind)  # grows in place: a log may be half as large as the memory
    kept = _longest_part(kept, path, skipped)
    if first is None or len(kept) < MIN_SCANS:
        reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        raise ValueError(f"{path}: {len(kept)} scans can be used ({reasons or 'it has no others'}): need {MIN_SCANS}")
    if skipped[NOT_LATER] > MOSTLY * len(kept):
        raise ValueError(
            f"{path}: {skipped[NOT_LATER]} scans are {NOT_LATER}, {len(kept)} are later: its times are lost"
        )
    sample = kept["ranges"][:: max(1, len(kept) // 1000)]
    finite = sample[np.isfinite(sample)]
    if len(finite) and np.median(finite) > MILLIMETERS:
        raise ValueError(f"{path}: the median range is {np.median(finite):.0f}: expected meters")
    angles, ranges = in_order(first.first_angle + first.spacing * np.arange(count), kept["ranges"])
    poses = kept["pose"].copy()
    if np.abs(poses[:, 2]).max() > MAX_HEADING:
        raise ValueError(f"{path}: some headings are {': '.join(DEGREES)}")
    poses[:, 2] = np.unwrap(poses[:, 2])
    return ScanLog(kept["stamp"].copy(), ranges, angles, poses, dict(skipped), first.range_max_m)


def _usable(scans: Iterable[LogScan], path: Path, spacing_s: float, skipped: Counter[str]) -> Iterator[LogScan]:
    scans = iter(scans)
    head = list(islice(scans, HEAD))
    first = _with_most_frequent_beams(head)
    if first:
        check_beams(first, str(path))
    last = -math.inf
    for scan in chain(head, scans):
        if scan.stamp < last - SET_BACK_S:
            last = -math.inf
        reason = why_unusable(scan, first, last)
        if not reason and scan.stamp - last < spacing_s:
            reason = f"less than {spacing_s:.3g} s after the one before"
        if reason:
            skipped[reason] += 1
        else:
            last = scan.stamp
            yield scan


def _with_most_frequent_beams(scans: list[LogScan]) -> LogScan | None:
    """Return the first of the scans that have the most frequent beams; None if none has beams."""
    with_beams = [each for each in scans if len(each.ranges)]
    return max(with_beams, key=lambda each: sum(has_same_beams(each, other) for other in with_beams), default=None)


def _longest_part(kept: np.ndarray, path: Path, skipped: Counter[str]) -> np.ndarray:
    """Return the longest part of the rows of a log in which time does not go back; the others are counted.

    Raises:
        ValueError: time goes back too often for a clock that is set.
    """
    parts = np.split(kept, np.flatnonzero(np.diff(kept["stamp"]) < 0) + 1)
    if len(parts) > MOSTLY:
        raise ValueError(
            f"{path}: time goes back by more than {SET_BACK_S:g} s {len(parts) - 1} times: its times are lost"
        )
    longest = max(parts, key=len)
    if len(longest) < len(kept):
        skipped[SET_BACK] += len(kept) - len(longest)
    return longest


def why_unusable(scan: LogScan, first: LogScan | None, last: float) -> str | None:
    """Return why a scan cannot be used after the first one and one at the time `last` [s]; None if it can."""
    if not math.isfinite(scan.stamp):
        return "without a time"
    if scan.stamp <= last:
        return NOT_LATER
    if not len(scan.ranges):
        return "without beams"
    if scan.pose is None or not np.isfinite(scan.pose).all():
        return "without a pose"
    if first and len(scan.ranges) != len(first.ranges):
        return f"with another number of beams than {len(first.ranges)}"
    if first and not has_same_beams(scan, first):
        return "with other beam angles"
    if np.isnan(valid_ranges(scan)).all():
        return "without a valid reading"
    return None


def has_same_beams(scan: LogScan, other: LogScan) -> bool:
    """Return whether two scans have the same number of beams at the same angles."""
    angles, others = ((each.first_angle, each.spacing) for each in (scan, other))
    return len(scan.ranges) == len(other.ranges) and np.allclose(angles, others, atol=1e-4)


def check_beams(scan: LogScan, source: str) -> None:
    """Check the beams of a scan.

    Raises:
        ValueError: they are not those of a lidar; the message begins with the source of the scan.
    """
    if not 2 <= len(scan.ranges) <= MAX_BEAMS:
        raise ValueError(f"{source}: expected scans of 2 to {MAX_BEAMS} beams, got {len(scan.ranges)}")
    span = abs(scan.spacing) * (len(scan.ranges) - 1)
    if not math.isfinite(scan.first_angle) or not 0 < span <= 2 * math.pi + 0.1:
        raise ValueError(
            f"{source}: expected beam angles in radians within one turn, got {len(scan.ranges)} beams from "
            f"{scan.first_angle:.4g} with a spacing of {scan.spacing:.4g}"
        )
    if not scan.range_max_m > max(scan.range_min_m, 0):
        raise ValueError(f"{source}: expected a positive maximum range, got {scan.range_max_m:.4g}")


def valid_ranges(scan: LogScan) -> np.ndarray:
    """Return the ranges of a scan with inf for a miss and NaN for an invalid reading, see `readings`."""
    return readings(scan.ranges, scan.range_min_m, scan.range_max_m)


def readings(ranges: np.ndarray, range_min_m: float, range_max_m: float) -> np.ndarray:
    """Return ranges [m] with inf for a miss, at or beyond the maximum, and NaN for an invalid reading, float32.

    Invalid are zero, what is below the minimum, and NaN. Many lidars report a lost beam in these ways; it must not
    mark the pixels along it as free.
    """
    ranges = np.asarray(ranges, dtype=np.float32)
    is_valid = (ranges >= range_min_m) & (ranges > 0)  # false for NaN
    return np.where(is_valid, np.where(ranges < range_max_m, ranges, np.inf), np.nan).astype(np.float32)


def note_on_range(range_max_m: float, reach_m: float) -> str | None:
    """Return a note about a lidar whose range [m] is not known or below that of the training; None if it is neither."""
    if reach_m and math.isinf(range_max_m):
        return f"the maximum range of the lidar is not known: a miss shows free space up to {reach_m:.4g} m"
    if range_max_m >= reach_m:
        return None
    return (
        f"misses show free space up to the maximum range of the lidar, {range_max_m:.4g} m; "
        f"the network was trained with {reach_m:.4g} m"
    )


def in_order(angles: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the beams by increasing angle, without the last ones of a full turn that point where the first ones do."""
    if angles[-1] < angles[0]:
        angles, ranges = angles[::-1], ranges[:, ::-1]
    count = int((angles < angles[0] + 2 * math.pi - 1e-6).sum())
    angles, ranges = angles[:count], ranges[:, :count]
    return (angles - 2 * math.pi if angles[-1] > 2 * math.pi else angles.copy()), np.ascontiguousarray(ranges)
