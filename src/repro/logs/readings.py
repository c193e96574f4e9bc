"""Readings of a lidar: hits, misses and invalid ones, and what their values tell about it."""

import math

import numpy as np

from repro.maps.validity import MAX_HEADING, MAX_MEDIAN_M, RADIANS
from repro.system.arrays import real
from repro.system.errors import InputError

MAX_STAMP_S = 1e11  # the year 5138; a clock in ms, us or ns is beyond it
LEAST_REPEATS = 10  # times as many readings as of the second largest value, so that the largest one looks like a miss


def check_heading(heading: float, subject: str) -> None:
    """Refuse a heading, or the largest of several, of more than ten turns; the message begins with the subject."""
    if abs(heading) > MAX_HEADING:
        raise InputError(f"{subject} like degrees, the largest is {abs(heading):.4g}: {RADIANS}")


def check_stamp(stamp: float, step_s: float) -> float:
    """Return a time; refuse one that is not finite, or too coarse for steps of `step_s` [s], as in ns, us or ms."""
    stamp = float(real("time", stamp, ()))
    if not math.isfinite(stamp):
        raise InputError(f"time: expected finite seconds, got {stamp!r}")
    if abs(stamp) < MAX_STAMP_S and np.spacing(abs(stamp)) < 0.01 * step_s:
        return stamp
    resolution = f"float64 resolves {np.spacing(abs(stamp)):.2g} there"
    raise InputError(f"time: expected seconds, not ms, us or ns, got {stamp:.4g}: {resolution}")


def readings(ranges: np.ndarray, range_min_m: float, range_max_m: float, misses: str = "free") -> np.ndarray:
    """Return ranges [m] with inf for a miss, at or beyond the maximum, and NaN for an invalid reading, float32.

    Invalid are negative readings, zero, what is below the minimum, NaN, what is masked, and misses if they are taken as
    `invalid`, see `misses`. Many lidars report a lost beam in these ways; it must not mark the pixels along it as free.

    Raises:
        InputError: the maximum is not positive and above the minimum, or the readings are no floating-point numbers.
    """
    if not range_max_m > max(range_min_m, 0):  # false for NaN
        raise InputError(f"expected a maximum range above the minimum, got {range_min_m} to {range_max_m} m")
    mask = np.ma.getmask(ranges)
    ranges = real("ranges [m]", np.ma.getdata(ranges) if np.ma.isMA(ranges) else ranges, kinds="f").astype(np.float32)
    is_valid = (ranges >= range_min_m) & (ranges > 0) & ~mask  # false for NaN
    miss = np.inf if misses == "free" else np.nan
    return np.where(is_valid, np.where(ranges < range_max_m, ranges, miss), np.nan).astype(np.float32)


def is_in_meters(ranges: np.ndarray) -> bool:
    """Return whether the ranges of a scan, as its driver gives them, can be meters; its largest may stand for a miss.

    Beyond the maximum range, those in millimeters would be misses, and the place would look empty.
    """
    finite = np.ma.compressed(np.ma.masked_invalid(ranges))
    measured = finite[finite < finite.max()] if len(finite) else finite
    return not (len(measured) and np.median(measured) > MAX_MEDIAN_M)


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
    """Return a note if the largest range [m] of (S, N) repeats like misses that a driver reports as hits; or None."""
    largest = np.max(ranges, where=np.isfinite(ranges), initial=0)
    second = np.max(ranges, where=ranges < largest, initial=0)  # false for inf and NaN
    count = int((ranges == largest).sum())
    if not largest or count < LEAST_REPEATS * max(1, int((ranges == second).sum())):
        return None
    return (
        f"{count} readings are exactly {largest!s} m, which looks like the maximum range of the lidar: "
        f"set prediction.range_max_m={str(largest).removesuffix('.0')}"
    )


def beams_of_turn(angles: np.ndarray) -> int:
    """Return the number of beams, by increasing angle [rad], before the first that points where the first one does."""
    return int((angles < angles[0] + 2 * math.pi - 1e-6).sum())
