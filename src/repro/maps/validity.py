"""Checks of scans from outside: values that a lidar and a localized robot cannot have, and windows without information.

Without these checks a broken sensor yields a map that is free everywhere, the worst error on a robot.
"""

import math

import numpy as np

from repro.maps.grid import Grid
from repro.maps.statistics import lower_median
from repro.scans import Scans, wrapped
from repro.system.errors import InputError

MAX_HEADING = 20 * math.pi  # [rad], ten turns without wrapping; headings in degrees exceed it
FULL_TURN = 2 * math.pi + 0.1  # [rad]; the last beams of some lidars point where the first ones do
JUMP = 1.0  # [rad]; headings in degrees, taken as radians, change by more unless the robot hardly turns
MIN_VALID = 0.05  # of the readings; a map from fewer would be nearly free of obstacles, and of reasons
MIN_STEPS = 10  # of which most are jumps
MAX_MEDIAN_M = 300.0  # median range beyond which no 2D lidar measures; the readings are in other units
RADIANS = "expected radians, from -pi to pi if the robot turns often"


def check_windows(windows: Scans, grid: Grid, *, allow_empty: bool = False) -> None:
    """Check the values of scans before a map is predicted from them.

    Args:
        windows: a batch of windows, see `Scans.batched`.
        allow_empty: accept windows of few valid readings, or of a robot outside the map.

    A window without a hit is one of an empty place.

    Raises:
        InputError: a window has no valid reading, a range is not positive, the median of the ranges is beyond
            `MAX_MEDIAN_M`, an angle or pose is not finite or seems to be in degrees; or, unless `allow_empty`, less
            than `MIN_VALID` of the readings are valid, or the robot is outside the map at the last step or at most
            steps.
    """
    ranges, angles, poses = windows.ranges, windows.angles, windows.poses
    expected = "expected meters, inf for a miss, NaN for an invalid reading"
    _refuse(np.isnan(ranges).all((1, 2)), "windows", "without a valid reading", expected)
    _refuse(ranges <= 0, "ranges", "zero or negative", expected)
    median_m = lower_median(np.where(np.isfinite(ranges), ranges, np.nan).reshape(len(ranges), -1))  # NaN without a hit
    _refuse(median_m > MAX_MEDIAN_M, "windows", f"of ranges with a median beyond {MAX_MEDIAN_M:g}", "expected meters")
    check_angles(angles)
    _refuse(~np.isfinite(poses), "poses", "not finite", "expected x, y [m] and heading [rad] at every step")
    _refuse(np.abs(poses[..., 2]) > MAX_HEADING, "headings", "beyond ten turns", RADIANS)
    _refuse(jumps(poses[..., 2]), "windows", "of headings that jump at most steps", RADIANS)
    if allow_empty:
        return
    valid = 1 - np.isnan(ranges).mean((1, 2))
    expected = f"expected at least {MIN_VALID:.0%} of them, of which the fewest have {valid.min():.1%}"
    _refuse(valid < MIN_VALID, "windows", "with too few valid readings", expected)
    inside = np.all((poses[..., :2] >= 0) & (poses[..., :2] <= grid.size_m), axis=-1)  # (B, T)
    expected = f"expected the last pose and most others on the map, x and y from 0 to {grid.size_m:g} m"
    _refuse(~inside[:, -1], "windows", "of a robot that is outside the map at the last step", expected)
    _refuse(inside.mean(1) < 0.5, "windows", "of a robot that is outside the map at most steps", expected)


def check_angles(angles: np.ndarray) -> None:
    """Check the angles of the beams, (N,).

    Raises:
        InputError: one is not finite or seems to be in degrees, or they are more than a turn apart.
    """
    _refuse(~np.isfinite(angles), "angles", "not finite", "expected radians")
    expected = "expected radians, in the lidar's frame"
    _refuse(np.abs(angles) > 2 * math.pi + 1e-3, "angles", "beyond a full turn", expected)
    expected = "expected radians, all within one turn"
    _refuse(angles - angles.min() > FULL_TURN, "angles", "more than a turn from the first", expected)


def jumps(headings: np.ndarray) -> np.ndarray:
    """Return whether headings (..., T) change by more than `JUMP` at most steps, as in degrees; bool, (...)."""
    if headings.shape[-1] < MIN_STEPS:
        return np.zeros(headings.shape[:-1], dtype=bool)
    return lower_median(np.abs(wrapped(np.diff(headings, axis=-1)))) > JUMP


def _refuse(wrong: np.ndarray, name: str, problem: str, expected: str) -> None:
    if wrong.any():
        raise InputError(f"{wrong.sum()} of {wrong.size} {name} are {problem}: {expected}")
