"""Windows of a log: as many steps as the network was trained with, at its step time, moved onto its map."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog, path_m
from repro.logs.times import ends_of, parts_of, steps_before
from repro.maps.statistics import Statistics
from repro.scans import Scans, wrapped
from repro.system.errors import InputError

LEAST_SCANS = 10  # different ones in a window that is spaced by distance


@dataclass(frozen=True)
class Window:
    """One window of a log.

    Args:
        number: its number in the log, from 1.
        stamp: time of its last step, which is that of its last scan [s].
        scans: ranges (T, N), angles (N,), poses (T, 3) on the map.
        origin: x, y of the lower left corner of the map in the frame of the log [m].
        following: the first scan after the window, on the same map: ranges (1, N), angles, poses (1, 3); None if there
            is none.
        held_out: the scan at the end of the window by the beams outside of a cropped field of view, on the same map:
            ranges (1, M), NaN for the beams inside, angles, poses (1, 3); None if the log was not cropped.
    """

    number: int
    stamp: float
    scans: Scans
    origin: tuple[float, float]
    following: Scans | None
    held_out: Scans | None = None


def cut(log: ScanLog, settings: WindowSettings, stride_s: float, size_m: float) -> Iterator[Window | str]:
    """Cut a log into windows, each of which ends with the scan nearest to `stride_s` after the one before.

    Each other step takes the scan nearest in time. A gap that no window can bridge divides the log: the first window
    after it begins with the scan after the gap.

    Args:
        stride_s: time between two windows [s]; scans if they are spaced by distance.
        size_m: side of the map [m].

    Yields:
        the windows, and for each gap and each part that is too short, what is left out.

    Raises:
        InputError: no part of the log is as long as one window, or its scans are too rare for the steps.
    """
    log.check_times(settings)
    number = 0
    for begin, end in parts_of(log.stamps, settings):
        stamps = log.stamps[begin:end]
        if begin:
            gap_s = float(stamps[0] - log.stamps[begin - 1])
            is_set_back = gap_s <= 0
            change = f"the time goes back by {-gap_s:.1f} s to" if is_set_back else f"no scans for {gap_s:.1f} s before"
            yield f"{change} {stamps[0]:.2f} s"
        ends = ends_of(stamps, settings, stride_s)
        if not len(ends):
            duration = stamps[-1] - stamps[0]
            yield f"{duration:.1f} s of scans from {stamps[0]:.2f} s, a window takes {settings.duration_s:.1f} s"
        for last in ends:
            number += 1
            index = begin + steps_before(stamps[: last + 1], settings)
            origin = settings.origin(log.poses[0], log.poses[begin + last], size_m)
            following = _on_map(log, [begin + last + 1], origin) if begin + last + 1 < end else None
            removed = log.held_out(begin + int(last))
            held_out = on_map(*removed, log.poses[[begin + last]], origin) if removed else None
            window = _on_map(log, index, origin)
            yield Window(number, float(stamps[last]), window, (float(origin[0]), float(origin[1])), following, held_out)


def spaced_by_distance(log: ScanLog, settings: WindowSettings, statistics: Statistics | None) -> WindowSettings:
    """Return the windows of a log in which the robot drives as far as in those of the training (median).

    The times of the log are the numbers of its scans, and the time of a step is counted in scans, of which a window has
    at least `LEAST_SCANS` different ones.

    Raises:
        InputError: the statistics are not known, or the robot does not drive.
    """
    if statistics is None:
        raise InputError("prediction.spacing=distance: the weights have no statistics, such as the path of the robot")
    driven_m, usual_m = path_m(log.poses), statistics.quantiles["path_m"][2]
    if not driven_m > 0 or not usual_m > 0:
        raise InputError(
            f"prediction.spacing=distance: the robot drives {driven_m:.3g} m in the log and {usual_m:.3g} m in a "
            "window of the training, and its scans cannot be spaced by distance"
        )
    scans = usual_m * (len(log) - 1) / driven_m  # in a window
    step = max(scans / settings.steps, LEAST_SCANS / settings.steps)
    return replace(settings, step_s=float(step), spacing="distance")


def on_map(ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray, origin: np.ndarray) -> Scans:
    """Return a window, see `Scans`, whose poses are moved from the frame of a log onto a map with an origin [m]."""
    poses = poses.copy()
    poses[:, :2] -= origin
    poses[:, 2] = wrapped(poses[:, 2])
    return Scans(np.ascontiguousarray(ranges), angles, poses)


def _on_map(log: ScanLog, index: np.ndarray | list[int], origin: np.ndarray) -> Scans:
    return on_map(log.ranges[index], log.angles, log.poses[index], origin)
