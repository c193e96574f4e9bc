"""Whether another convention of the poses would make the hits of a log sharper, such as a lidar that looks backward."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog, path_m
from repro.logs.times import ends_of, parts_of, steps_before
from repro.scans import Scans
from repro.system.compiled import compiled

WINDOWS, SCANS = 24, 8  # of a log, and of a window, that are compared
NEAR_M = 0.2  # between hits on the same obstacle
MIN_PATH_M = 0.5  # of the robot in a window, so that a wrong heading shows
MIN_GAIN, MIN_SHARE = 0.15, 0.5  # of the share of hits that are near others, with a convention that is named
TURNED = "a lidar that is turned by {} degrees, prediction.mounting=[0,0,{:.4f}]"
MIN_TURN, MIN_GAIN_OF_LAG = 0.3, 0.06  # of the robot in a window [rad]; of the share, whose peak is sharp in turns
LAGS_S = (-1.0, -0.5, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.5, 1.0)
CONVENTIONS = {  # turn [degrees] and scale of the headings, sense of the beams, scale of the positions
    **{TURNED.format(turn, math.radians(turn)): (turn, 1, 1, 1) for turn in (180, 90, -90)},
    "headings of the opposite sign": (0, -1, 1, 1),
    "headings clockwise from the y axis": (90, -1, 1, 1),
    "headings in degrees": (0, math.radians(1), 1, 1),
    "beams in the reverse order": (0, 1, -1, 1),
    "y of the opposite sign": (0, -1, -1, 1),  # a mirrored world, which looks alike, with other headings and beams
    "x of the opposite sign": (180, -1, -1, 1),
    "x and y exchanged": (90, -1, -1, 1),
    "positions in cm": (0, 1, 1, 0.01),
    "positions in mm": (0, 1, 1, 0.001),
}


def sharper_convention(log: ScanLog, settings: WindowSettings) -> str | None:
    """Return a message about a convention that puts more hits of a scan near those of the scans before; None if none.

    Mirrored worlds cannot be seen, nor can a wrong heading of a lidar that only turns on the spot.
    """
    windows = [index for index in _windows(log, settings) if path_m(log.poses[index]) >= MIN_PATH_M]
    if not windows:
        return None
    usual = _sharpness(log, windows)
    shares = {name: _sharpness(_changed(log, *change), windows) for name, change in CONVENTIONS.items()}
    best = max(shares, key=lambda name: shares[name])
    if not shares[best] > max(usual + MIN_GAIN, MIN_SHARE):
        return _clock_offset(log, windows) if settings.spacing == "time" else None
    return (
        f"{usual:.0%} of the hits are near those of the scans before, {shares[best]:.0%} with {best}: check the "
        "mounting of the lidar and the columns of the poses"
    )


def _clock_offset(log: ScanLog, windows: list[np.ndarray]) -> str | None:
    """Return a message about a time between scans and poses that blurs the hits of a robot that turns; None if none."""
    turning = [index for index in windows if np.ptp(log.poses[index, 2]) > MIN_TURN]
    if not turning or not (np.diff(log.stamps) > 0).all():
        return None
    usual, shares = _sharpness(log, turning), {lag: _sharpness(_shifted(log, lag), turning) for lag in LAGS_S}
    best = max(shares, key=lambda lag: shares[lag])
    if not shares[best] > usual + MIN_GAIN_OF_LAG:
        return None
    name = f"{abs(best):g} s {'later' if best > 0 else 'earlier'}"
    return (
        f"where the robot turns, {usual:.0%} of the hits are near those of the scans before, {shares[best]:.0%} with "
        f"the poses of {name}: the clocks of scans and poses differ; shift the stamps of one of them"
    )


def _sharpness(log: ScanLog, windows: list[np.ndarray]) -> float:
    """Return the share of the hits of the last scan of windows within `NEAR_M` of hits of the scans before; a mean."""
    shares = []
    for index in windows:
        points, hit = Scans(log.ranges[index], log.angles, log.poses[index]).points()
        before, last = points[:-1][hit[:-1]], points[-1][hit[-1]]
        if len(before) and len(last):
            shares.append(_share_near(before[np.argsort(before[:, 0])], last, NEAR_M))
    return float(np.mean(shares)) if shares else math.nan


def _windows(log: ScanLog, settings: WindowSettings) -> Iterator[np.ndarray]:
    """Yield the indices of a few scans of a few windows, evenly over the log."""
    stride_s = max(np.ptp(log.stamps) / WINDOWS, settings.step_s)  # also after the clock was set back
    for begin, end in parts_of(log.stamps, settings):
        for last in ends_of(log.stamps[begin:end], settings, stride_s):
            steps = begin + steps_before(log.stamps[begin : begin + last + 1], settings)
            yield np.unique(steps[np.linspace(0, len(steps) - 1, SCANS).astype(int)])


def _shifted(log: ScanLog, lag_s: float) -> ScanLog:
    """Return a log whose scans have the poses of a later time [s], in between interpolated."""
    later = log.stamps + lag_s
    return replace(log, poses=np.stack([np.interp(later, log.stamps, column) for column in log.poses.T], axis=-1))


def _changed(log: ScanLog, turn_deg: float, heading: float, sense: int, position: float) -> ScanLog:
    poses = log.poses * (position, position, heading) + (0, 0, math.radians(turn_deg))
    return replace(log, poses=poses, angles=sense * log.angles)


@compiled
def _share_near(points: np.ndarray, others: np.ndarray, near_m: float) -> float:
    """Return the share of others, (M, 2), that are near a point, (N, 2), which are in the order of x."""
    found = 0
    for other in range(len(others)):
        x, y = others[other]
        for point in range(np.searchsorted(points[:, 0], x - near_m), len(points)):
            if points[point, 0] > x + near_m:
                break
            if (points[point, 0] - x) ** 2 + (points[point, 1] - y) ** 2 <= near_m**2:
                found += 1
                break
    return found / len(others)
