"""One scan of a log or of a robot: its beams, its readings, and whether it can be used."""

import math
from dataclasses import dataclass

import numpy as np

from repro.maps.validity import MAX_HEADING, RADIANS
from repro.system.errors import InputError

MAX_BEAMS = 100_000
MANY = 10  # times as many readings as of the second largest value, so that the largest one looks like a miss
NOT_LATER, WITHOUT_BEAMS, WITHOUT_POSE = "not later than the one before", "without beams", "without a pose"
WITHOUT_RANGE = "without a valid maximum range"


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


def why_unusable(scan: LogScan, first: LogScan | None, last: float) -> str | None:
    """Return why a scan cannot be used after the first one and one at the time `last` [s]; None if it can."""
    if not math.isfinite(scan.stamp):
        return "without a time"
    if scan.stamp <= last:
        return NOT_LATER
    if not len(scan.ranges):
        return WITHOUT_BEAMS
    if scan.pose is None or not np.isfinite(scan.pose).all():
        return WITHOUT_POSE
    if first and len(scan.ranges) != len(first.ranges):
        return f"with another number of beams than {len(first.ranges)}"
    if first and not has_same_beams(scan, first):
        return "with other beam angles"
    if not has_valid_range(scan):
        return WITHOUT_RANGE
    if np.isnan(valid_ranges(scan)).all():
        return "without a valid reading"
    return None


def has_valid_range(scan: LogScan) -> bool:
    """Return whether the maximum range of a scan is positive and above the minimum, so that misses can be told."""
    return scan.range_max_m > max(scan.range_min_m, 0)  # false for NaN


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
        raise InputError(f"{source}: expected scans of 2 to {MAX_BEAMS} beams, got {len(scan.ranges)}")
    check_turn(len(scan.ranges), scan.first_angle, scan.spacing, source)
    if not has_valid_range(scan):
        raise InputError(f"{source}: expected a positive maximum range, got {scan.range_max_m:.4g}")


def check_turn(beams: int, first_angle: float, spacing: float, source: str) -> None:
    """Check that beams, with angles in radians, are within one turn.

    Raises:
        ValueError: they are not, or are in one direction; the message begins with the source of the scan.
    """
    if not math.isfinite(first_angle) or not 0 < abs(spacing) * (beams - 1) <= 2 * math.pi + 0.1:
        raise InputError(
            f"{source}: expected beam angles in radians within one turn, got {beams} beams from {first_angle:.4g} with "
            f"a spacing of {spacing:.4g}"
        )


def check_heading(heading: float, subject: str) -> None:
    """Check that a heading, or the largest of several, may be in radians.

    Raises:
        ValueError: it is more than ten turns; the message begins with the subject.
    """
    if abs(heading) > MAX_HEADING:
        raise InputError(f"{subject} like degrees, the largest is {abs(heading):.4g}: {RADIANS}")


def valid_ranges(scan: LogScan) -> np.ndarray:
    """Return the ranges of a scan with inf for a miss and NaN for an invalid reading, see `readings`."""
    return readings(scan.ranges, scan.range_min_m, scan.range_max_m)


def readings(ranges: np.ndarray, range_min_m: float, range_max_m: float) -> np.ndarray:
    """Return ranges [m] with inf for a miss, at or beyond the maximum, and NaN for an invalid reading, float32.

    Invalid are negative readings, zero, what is below the minimum, NaN, and what is masked. Many lidars report a lost
    beam in these ways; it must not mark the pixels along it as free.
    """
    ranges = np.ma.filled(np.ma.asarray(ranges).astype(np.float32), np.nan)
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


def note_on_repeats(ranges: np.ndarray) -> str | None:
    """Return a note about readings that look like misses that a driver reports as hits; None if there are none.

    Args:
        ranges: ranges [m], (S, N); inf for a miss, NaN for an invalid reading.
    """
    largest = np.max(ranges, where=np.isfinite(ranges), initial=0)
    second = np.max(ranges, where=ranges < largest, initial=0)  # false for inf and NaN
    count = int((ranges == largest).sum())
    if not largest or count < MANY * max(1, int((ranges == second).sum())):
        return None
    return (
        f"{count} readings are exactly {largest} m, which looks like the maximum range of the lidar: "
        f"set prediction.range_max_m={str(largest).removesuffix('.0')}"
    )


def note_on_changes(ranges_m: np.ndarray) -> str | None:
    """Return a note about maximum ranges [m], (S,), that change between the scans of a log; None if they do not."""
    found, counts = np.unique(ranges_m, return_counts=True)
    if len(found) <= 1:
        return None
    shown = ", ".join(f"{value:.4g} m in {count} scans" for value, count in zip(found[:5], counts[:5], strict=True))
    more = f" and {len(found) - 5} others" if len(found) > 5 else ""
    return f"the maximum range changes, {shown}{more}: misses show free space up to the smallest, {found[0]:.4g} m"


def in_order(angles: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the beams by increasing angle, without the last ones of a full turn that point where the first ones do."""
    if angles[-1] < angles[0]:
        angles, ranges = angles[::-1], ranges[:, ::-1]
    count = beams_of_turn(angles)
    angles, ranges = angles[:count], ranges[:, :count]
    return (angles - 2 * math.pi if angles[-1] > 2 * math.pi else angles.copy()), np.ascontiguousarray(ranges)


def beams_of_turn(angles: np.ndarray) -> int:
    """Return the number of beams, by increasing angle [rad], before the first that points where the first one does."""
    return int((angles < angles[0] + 2 * math.pi - 1e-6).sum())
