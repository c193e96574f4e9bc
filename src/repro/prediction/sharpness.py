"""Whether another convention of the poses would make the hits of a log sharper, such as a lidar that looks backward."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from repro.prediction.logs import ScanLog
from repro.prediction.times import WindowSettings, parts_of, steps_before

WINDOWS, SCANS = 24, 8  # of a log, and of a window, that are compared
NEAR_M = 0.2  # between hits on the same obstacle
MIN_PATH_M = 0.5  # of the robot in a window, so that a wrong heading shows
MIN_GAIN = 0.15  # of the share of hits that are near others
CONVENTIONS: dict[str, Callable[[ScanLog], ScanLog]] = {
    "a lidar that is turned by 180 degrees, prediction.mounting=[0,0,3.1416]": lambda log: _turned(log, math.pi),
    "a lidar that is turned by 90 degrees, prediction.mounting=[0,0,1.5708]": lambda log: _turned(log, math.pi / 2),
    "a lidar that is turned by -90 degrees, prediction.mounting=[0,0,-1.5708]": lambda log: _turned(log, -math.pi / 2),
    "headings of the opposite sign": lambda log: replace(log, poses=log.poses * (1, 1, -1)),
    "beams in the reverse order": lambda log: replace(log, angles=-log.angles),
    "x and y exchanged": lambda log: replace(log, poses=log.poses[:, [1, 0, 2]]),
}


def sharper_convention(log: ScanLog, settings: WindowSettings) -> str | None:
    """Return a message about a convention that puts more hits of a scan near those of the scans before; None if none.

    Mirrored worlds cannot be seen, nor can a wrong heading of a lidar that only turns on the spot.

    Args:
        log: the log.
        settings: steps of the windows.
    """
    windows = [index for index in _windows(log, settings) if _path_m(log, index) >= MIN_PATH_M]
    if not windows:
        return None
    usual = sharpness(log, windows)
    shares = {name: sharpness(change(log), windows) for name, change in CONVENTIONS.items()}
    best = max(shares, key=lambda name: shares[name])
    if not shares[best] > usual + MIN_GAIN:
        return None
    return (
        f"{usual:.0%} of the hits are near those of the scans before, {shares[best]:.0%} with {best}: check the "
        "mounting of the lidar and the columns of the poses"
    )


def sharpness(log: ScanLog, windows: list[np.ndarray]) -> float:
    """Return the share of the hits of the last scan of windows within `NEAR_M` of hits of the scans before; a mean.

    Args:
        log: the log.
        windows: indices of some scans of each window, in the order of time.
    """
    shares = []
    for index in windows:
        hits = [_hits(log, number) for number in index]
        before = np.concatenate(hits[:-1])
        if len(before) and len(hits[-1]):
            distance, _ = cKDTree(before).query(hits[-1], distance_upper_bound=NEAR_M)
            shares.append(float(np.isfinite(distance).mean()))
    return float(np.mean(shares)) if shares else math.nan


def _windows(log: ScanLog, settings: WindowSettings) -> list[np.ndarray]:
    """Return the indices of a few scans of a few windows, evenly over the log."""
    ends = [
        (begin, last)
        for begin, end in parts_of(log.stamps, settings)
        for last in range(begin, end)
        if settings.is_filled(log.stamps[begin], log.stamps[last])
    ]
    chosen = [ends[place] for place in np.linspace(0, len(ends) - 1, WINDOWS).astype(int)] if ends else []
    found = []
    for begin, last in dict.fromkeys(chosen):
        scans = np.unique(begin + steps_before(log.stamps[begin : last + 1], settings))
        found.append(scans[np.unique(np.linspace(0, len(scans) - 1, SCANS).astype(int))])
    return found


def _path_m(log: ScanLog, index: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(log.poses[index, :2], axis=0), axis=1).sum())


def _hits(log: ScanLog, number: int) -> np.ndarray:
    x, y, heading = log.poses[number]
    hit = np.isfinite(log.ranges[number])
    angles, ranges = heading + log.angles[hit], log.ranges[number][hit]
    return np.stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)], axis=-1)


def _turned(log: ScanLog, turn: float) -> ScanLog:
    return replace(log, poses=log.poses + np.array([0, 0, turn]))
