"""Whether scans and poses fit together. If they do not, maps are wrong, and agree with the next scan all the same.

Where most things stand, half or more of the hits of a scan are near those of the scans before, and another convention,
such as a lidar that looks backward, puts hardly more there. `reproduce.real.spoiled` counts which faults are found.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog, path_m
from repro.logs.times import between_scans_s, ends_of, parts_of, steps_before
from repro.scans import Scans, repeats
from repro.system.compiled import compiled

WINDOWS, SCANS = 24, 8  # of a log, and of a window, that are compared
SPACING = math.radians(1)  # between the beams that are compared
MIN_HITS, HITS = 10, 200  # of the last scan of a window
NEAR_M = 0.2  # between hits on the same obstacle
APART = 0.9  # windows, from the end of the first to that of the last one, so that they are independent
MIN_PATH_M, MIN_TURN = 0.5, 0.3  # of the robot in a window [m, rad], so that wrong headings or times show
MIN_GAIN, MIN_SHARE = 0.06, 0.55  # of the hits that are near others, so that a convention is named
MIN_WINDOWS, MIN_BETTER = 4, 0.8  # with hits; of all differences between windows, the part that is a gain
USUAL_SHARE = 0.4  # of a lidar that sees what stands
MAX_REPEATED = 0.2  # share of the robot's moves after which the readings are those of the scan before
MOVE_M, MOVE_RAD, SEEN = 0.02, 0.01, 0.3  # from scan to scan, which changes readings; of the beams, which hit something
FEW = 4  # steps from scan to scan
LAGS_S = (-1.0, -0.5, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.5, 1.0)
TURNED = "a lidar that is turned by {} degrees more: add {:.4f} rad to the heading of its mounting"
Changes = dict[str, tuple[float, ...]]  # turn [degrees] and scale of headings, sense of the beams, scale of positions
CONVENTIONS: Changes = {
    **{TURNED.format(turn, math.radians(turn)): (turn, 1, 1, 1) for turn in range(-170, 181, 10) if turn},
    "headings of the opposite sign": (0, -1, 1, 1),
    "headings clockwise from the y axis": (90, -1, 1, 1),
    "beams in the reverse order": (0, 1, -1, 1),
    "y of the opposite sign": (0, -1, -1, 1),  # a mirrored world, which looks alike, with other headings and beams
    "x of the opposite sign": (180, -1, -1, 1),
    "x and y exchanged": (90, -1, -1, 1),
}
DEGREES: Changes = {"headings in degrees": (0, math.radians(1), 1, 1)}  # as good where a robot hardly turns
UNITS: Changes = {"positions in cm": (0, 1, 1, 0.01), "positions in mm": (0, 1, 1, 0.001)}  # or hardly drives
LARGE_RAD, LARGE_M = 2 * math.pi, 100.0  # turn and path in a window, beyond which the unit is doubted


def inconsistencies(log: ScanLog, settings: WindowSettings) -> list[str]:
    """Return messages about scans and poses that do not fit together.

    Mirrored worlds cannot be seen, nor can a wrong heading of a lidar that only turns on the spot, or among obstacles
    that all move.
    """
    return [message for message in (_repeated(log), _misplaced(log, settings)) if message]


def _repeated(log: ScanLog) -> str | None:
    """Return a message about readings that come again while the robot moves."""
    is_same = repeats(log.ranges) & (np.isfinite(log.ranges[1:]).mean(1) > SEEN)
    moves = (np.abs(np.diff(log.poses, axis=0)) > (MOVE_M, MOVE_M, MOVE_RAD)).any(1)
    share = (is_same & moves).sum() / max(moves.sum(), 1)
    if share <= MAX_REPEATED:
        return None
    return f"{share:.0%} of the scans of the moving robot have exactly the readings of the scan before: leave these out"


def note_on_rare(stamps: np.ndarray, settings: WindowSettings) -> str | None:
    """Return a message about scans that are rare for the steps of a window, given their times [s], (S,)."""
    between_s = between_scans_s(stamps)
    if settings.spacing == "distance" or between_s <= FEW * settings.step_s:
        return None
    return (
        f"a scan every {between_s:.2g} s, the steps of a window take {settings.step_s:g} s: are these times in seconds?"
    )


def note_on_blur(log: ScanLog, settings: WindowSettings) -> str | None:
    """Return a message about hits that are rarely near those before; None if they often are."""
    log = _thinned(log)
    shares = _sharpness(log, _windows(log, settings))
    if not len(shares) or (share := shares.mean()) >= USUAL_SHARE:
        return None
    return (
        f"{share:.0%} of the hits are near those of the scans before: most of what the lidar sees moves, or columns, "
        "units, sign or times of the poses, or the angles of the beams are wrong"
    )


def _misplaced(log: ScanLog, settings: WindowSettings) -> str | None:
    """Return a message about other poses or beams that make the hits sharper; None without two windows of driving."""
    log = _thinned(log)
    driving = [index for index in _windows(log, settings) if path_m(log.poses[index]) >= MIN_PATH_M]
    ends = log.stamps[[index[-1] for index in driving]]
    if not len(driving) or ends[-1] - ends[0] < APART * settings.duration_s:
        return None
    conventions = dict(CONVENTIONS)
    if np.median([path_m(log.poses[index]) for index in driving]) > LARGE_M:
        conventions |= UNITS
    if max(np.ptp(log.poses[index, 2]) for index in driving) > LARGE_RAD:
        conventions |= DEGREES
    found = [_sharper(log, driving, {f"with {name}": _changed(log, *how) for name, how in conventions.items()})]
    if settings.spacing == "time" and (np.diff(log.stamps) > 0).all():
        turning = [index for index in driving if np.ptp(log.poses[index, 2]) > MIN_TURN]
        found.append(_sharper(log, turning, {_named(lag_s): _shifted(log, lag_s) for lag_s in LAGS_S}))
    gain, message = max(found)
    return message if gain > MIN_GAIN else None


def _sharper(log: ScanLog, windows: list[np.ndarray], changed: Mapping[str, ScanLog]) -> tuple[float, str]:
    """Return how many more hits of windows are near others in the best of changed logs, and its message.

    Nothing is gained unless most hits are near others, and the best is better in most windows.
    """
    if len(windows) < MIN_WINDOWS:
        return 0.0, ""
    usual, shares = _sharpness(log, windows), {name: _sharpness(other, windows) for name, other in changed.items()}
    best = max(shares, key=lambda name: shares[name].mean())
    gains, share = shares[best] - usual, shares[best].mean()
    if share < MIN_SHARE or gains.clip(0).sum() < MIN_BETTER * np.abs(gains).sum():
        return 0.0, ""
    return gains.mean(), f"{usual.mean():.0%} of the hits are near those of the scans before, {share:.0%} {best}"


def _sharpness(log: ScanLog, windows: list[np.ndarray]) -> np.ndarray:
    """Return the share of the hits of the last scan of windows within `NEAR_M` of hits of the scans before, (W,)."""
    shares = np.zeros(len(windows))
    for number, index in enumerate(windows):
        points, hit = Scans(log.ranges[index], log.angles, log.poses[index]).points()
        before, last = points[:-1][hit[:-1]], points[-1][hit[-1]]
        shares[number] = _share_near(before[np.argsort(before[:, 0])], last[:: math.ceil(len(last) / HITS)], NEAR_M)
    return shares


def _thinned(log: ScanLog) -> ScanLog:
    """Return a log with beams that are `SPACING` apart or a little less, unless all are farther apart."""
    every = max(1, int(SPACING / abs(log.angles[1] - log.angles[0]))) if len(log.angles) > 1 else 1
    return replace(log, ranges=log.ranges[:, ::every], angles=log.angles[::every])


def _windows(log: ScanLog, settings: WindowSettings) -> list[np.ndarray]:
    """Return the indices of a few scans of a few windows, evenly over the log, whose first and last scans have hits."""
    found, stride_s = list[np.ndarray](), max(np.ptp(log.stamps) / WINDOWS, settings.step_s)  # also of a clock set back
    for begin, end in parts_of(log.stamps, settings):
        for last in ends_of(log.stamps[begin:end], settings, stride_s):
            steps = begin + steps_before(log.stamps[begin : begin + last + 1], settings)
            index = np.unique(steps[np.linspace(0, len(steps) - 1, SCANS).astype(int)])
            hits = np.isfinite(log.ranges[index]).sum(1)
            if min(hits[-1], hits[:-1].max(initial=0)) >= MIN_HITS:
                found.append(index)
    return found


def _named(lag_s: float) -> str:
    when = f"{abs(lag_s):g} s {'later' if lag_s > 0 else 'earlier'}"
    return f"with the poses of {when}: the clocks of scans and poses differ; shift the stamps of one of them"


def _shifted(log: ScanLog, lag_s: float) -> ScanLog:
    """Return a log whose scans have the poses of a later time [s], in between interpolated."""
    later = log.stamps + lag_s
    return replace(log, poses=np.stack([np.interp(later, log.stamps, column) for column in log.poses.T], axis=-1))


def _changed(log: ScanLog, turn_deg: float, heading: float, sense: float, position: float) -> ScanLog:
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
