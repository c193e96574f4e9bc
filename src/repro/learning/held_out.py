"""Windows of the log of a wide lidar through a narrow view, whose maps the beams outside of the view label.

The labels are partial, as those of Ondruska and Posner (AAAI 2016): pixels that the other beams hit or
passed over at the end of a window, unknown elsewhere. A lidar that drives looks through a view in a fixed direction.
One that stands looks through a view that swings, since a view at rest would show nothing that it has left.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter

from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.grid import Grid
from repro.prediction.agreement import Observed, observed
from repro.prediction.windows import Window, cut
from repro.scans import Scans
from repro.system.errors import InputError

SWING, PERIOD_S = math.pi / 4, 10.0  # of the view of a lidar that stands: amplitude and period of its direction
STILL_M = 0.1  # extent of the positions of a lidar that stands
MIN_BESIDE = math.radians(10)  # that a lidar must see on each side of the view


@dataclass(frozen=True)
class View:
    """A view of a wide lidar.

    Args:
        fov_rad: field of view [rad].
        turn_rad: its direction from straight ahead [rad]; of one that swings, its phase.
        range_max_m: range up to which a beam without a hit labels free pixels [m].
    """

    fov_rad: float = math.pi / 2
    turn_rad: float = 0.0
    range_max_m: float = 30.0


def stands(log: ScanLog) -> bool:
    """Return whether the lidar of a log does not move."""
    return bool((np.ptp(log.poses[:, :2], axis=0) < STILL_M).all())


def turns_of(log: ScanLog, fov_rad: float) -> list[float]:
    """Return the directions of views of a lidar that differ by 45 degrees or a little less [rad]; all are within it.

    Raises:
        InputError: the lidar does not see enough beside a view.
    """
    sees = float(np.ptp(log.angles))
    if sees < fov_rad + 2 * MIN_BESIDE:
        raise InputError(
            f"expected a lidar that sees {math.degrees(fov_rad + 2 * MIN_BESIDE):.0f} degrees or more, since the beams "
            f"outside of a view of {math.degrees(fov_rad):.0f} degrees say what is true there, got "
            f"{math.degrees(sees):.0f} degrees"
        )
    most = (sees - fov_rad) / 2
    middle = float(log.angles[0] + log.angles[-1]) / 2
    count = 2 * math.ceil(most / SWING) + 1
    return [middle + float(turn) for turn in np.linspace(-most, most, count)]


def labeled(
    log: ScanLog, settings: WindowSettings, stride: float, grid: Grid, view: View
) -> Iterator[tuple[Window, Observed]]:
    """Yield the windows of a log through a view, with what the other beams show of their maps.

    Args:
        log: the log of a wide lidar.
        settings: center and steps of the windows.
        stride: steps between the ends of two windows.
        grid: grid of the maps.
        view: the view.

    Raises:
        InputError: the log has no windows, or the lidar does not see beyond the view.
    """
    windows = _swinging if stands(log) else _driving
    for window in windows(log, settings, stride, grid, view):
        assert window.held_out, "the lidar sees beyond the view"
        scan = observed(window.held_out, grid, min(log.range_max_m, view.range_max_m))
        yield window, Observed(scan.hits, scan.passed & ~maximum_filter(scan.hits, 3))  # none beside a hit


def _driving(log: ScanLog, settings: WindowSettings, stride: float, grid: Grid, view: View) -> Iterator[Window]:
    turn = np.array([0, 0, view.turn_rad])
    turned = replace(log, angles=log.angles - view.turn_rad, poses=log.poses + turn)
    yield from _windows(turned.crop(view.fov_rad), settings, stride, grid)


def _swinging(log: ScanLog, settings: WindowSettings, stride: float, grid: Grid, view: View) -> Iterator[Window]:
    virtual, beams = swinging(log, view)
    for window in _windows(virtual, settings, stride, grid):
        number = int(np.searchsorted(log.stamps, window.stamp))
        ranges = np.where(np.isin(np.arange(len(log.angles)), beams), log.ranges[number], np.nan)
        ranges[beams[number]] = np.nan
        place = np.array([[grid.size_m / 2, grid.size_m / 2, 0.0]])
        yield replace(window, held_out=Scans(ranges[None], log.angles, place))


def _windows(log: ScanLog, settings: WindowSettings, stride: float, grid: Grid) -> Iterator[Window]:
    for window in cut(log, settings, stride * settings.step_s, grid.size_m):
        if isinstance(window, Window):  # the others are messages about gaps
            yield window


def swinging(log: ScanLog, view: View) -> tuple[ScanLog, np.ndarray]:
    """Return the log of a view that swings at the place of a lidar that stands, and the beams that it has, (S, N).

    Raises:
        InputError: the lidar does not see all that the view sweeps.
    """
    spacing = float(np.diff(log.angles).mean())
    phase = 2 * np.pi * (log.stamps - log.stamps[0]) / PERIOD_S + view.turn_rad
    turns = np.rint(SWING * np.sin(phase) / spacing).astype(int)  # in beams
    ahead = np.flatnonzero(np.abs(log.angles) <= view.fov_rad / 2)
    beams = ahead + turns[:, None]
    if not len(ahead) or beams.min() < 0 or beams.max() >= len(log.angles):
        raise InputError(f"expected a lidar of {math.degrees(2 * SWING + view.fov_rad):g} degrees or more")
    poses = np.zeros((len(log), 3))
    poses[:, 2] = turns * spacing
    ranges = np.take_along_axis(log.ranges, beams, axis=1)
    return replace(log, ranges=ranges, angles=log.angles[ahead], poses=poses), beams
