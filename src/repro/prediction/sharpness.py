"""Whether another convention of the poses would make the hits of a log sharper, such as a lidar that looks backward."""

import math
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from repro.prediction.logs import ScanLog
from repro.prediction.times import WindowSettings, parts_of, steps_before

WINDOWS, SCANS = 24, 8  # of a log, and of a window, that are compared
NEAR_M = 0.2  # between hits on the same obstacle
MIN_PATH_M = 0.5  # of the robot in a window, so that a wrong heading shows
MIN_GAIN, MIN_SHARE = 0.15, 0.5  # of the share of hits that are near others, with a convention that is named
BEAMS = "beams in the reverse order"
TURNED = "a lidar that is turned by"
CONVENTIONS = {  # turn [degrees] and scale of the headings, sense of the beams, scale of the positions
    f"{TURNED} 180 degrees, prediction.mounting=[0,0,3.1416]": (180, 1, 1, 1),
    f"{TURNED} 90 degrees, prediction.mounting=[0,0,1.5708]": (90, 1, 1, 1),
    f"{TURNED} -90 degrees, prediction.mounting=[0,0,-1.5708]": (-90, 1, 1, 1),
    "headings of the opposite sign": (0, -1, 1, 1),
    "headings clockwise from the y axis": (90, -1, 1, 1),
    "headings clockwise from the -x axis": (180, -1, 1, 1),
    "headings clockwise from the -y axis": (-90, -1, 1, 1),
    "headings in degrees": (0, math.radians(1), 1, 1),
    BEAMS: (0, 1, -1, 1),
    f"{BEAMS} and {TURNED} 180 degrees": (180, 1, -1, 1),
    f"{BEAMS} and {TURNED} 90 degrees": (90, 1, -1, 1),
    f"{BEAMS} and {TURNED} -90 degrees": (-90, 1, -1, 1),
    "y of the opposite sign": (0, -1, -1, 1),  # a mirrored world, which looks alike, with other headings and beams
    "x of the opposite sign": (180, -1, -1, 1),
    "x and y exchanged": (90, -1, -1, 1),
    "x and y exchanged and of the opposite sign": (-90, -1, -1, 1),
    "positions in feet": (0, 1, 1, 0.3048),
    "positions in cm": (0, 1, 1, 0.01),
    "positions in mm": (0, 1, 1, 0.001),
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
    shares = {name: sharpness(_changed(log, *change), windows) for name, change in CONVENTIONS.items()}
    best = max(shares, key=lambda name: shares[name])
    if not shares[best] > max(usual + MIN_GAIN, MIN_SHARE):
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


def _changed(log: ScanLog, turn_deg: float, heading: float, sense: int, position: float) -> ScanLog:
    poses = log.poses * (position, position, heading) + (0, 0, math.radians(turn_deg))
    return replace(log, poses=poses, angles=sense * log.angles)
