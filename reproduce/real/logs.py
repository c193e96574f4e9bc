"""Windows of real logs with the beams that their maps are compared with.

Logs of driving robots are gzipped CARMEN files with poses corrected by a scan matcher. They have a scan every 0.5 to
1 m (freiburg-079: every 0.09 m), and some have lost their times. Therefore time counts scans. The time of a step is
such that the robot drives as far in a window as in the training, but at most ten steps have the same scan. The lidar is
cropped to 90 degrees straight ahead.

Bags of a standing lidar have no poses. A virtual lidar of 90 degrees at its place swings by 45 degrees to both sides.
The beams that are held out are those that it sweeps and does not have at the end of the window.
"""

import gzip
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter

from repro.maps.grid import Grid
from repro.networks.predictor import Predictor
from repro.prediction.agreement import Observed, observed
from repro.prediction.carmen import carmen_scans
from repro.prediction.logs import ReadOptions, ScanLog, collect
from repro.prediction.readers import read_log
from repro.prediction.times import WindowSettings, window_of
from repro.prediction.windows import Window, cut, spaced_by_distance
from repro.scans import Scans
from repro.system.errors import InputError

FOV, REACH_M = math.pi / 2, 30.0
STRIDE, STANDING_STRIDE = 10, 5  # steps between the ends of windows of a driving robot and of a standing lidar
SWING, PERIOD_S = math.pi / 4, 10.0  # of the virtual lidar: amplitude and period of its heading
NEARER_M = 0.4  # than the median of its beam over the log: a reading of something that moves
BLOCK_S = 10.0  # windows of a bag that are drawn together


@dataclass(frozen=True)
class Case:
    """A window and what held-out beams show of its map.

    Args:
        window: the window.
        range_max_m: maximum range of the lidar [m].
        clear: pixels that the held-out beams hit or passed over, without passed pixels beside a hit.
        moving: pixels of a hit on something that moves, bool, (H, W); None if that is not known.
        block: number of the part of the log whose windows are drawn together.
    """

    window: Window
    range_max_m: float
    clear: Observed
    moving: np.ndarray | None = None
    block: int = 0

    def groups(self, seen: np.ndarray) -> dict[str, Observed]:
        """Return the pixels that are compared, by kind, given those that a beam of the window has hit or passed over.

        Hits on what stands and on what moves are both compared with all passed pixels.
        """
        groups = {"all": self.clear, "seen": self.clear.within(seen), "unseen": self.clear.within(~seen)}
        if self.moving is not None:
            for name, hits in (("standing", ~self.moving), ("moving", self.moving)):
                groups[name] = Observed(self.clear.hits & hits, self.clear.passed)
        return groups


def cases_of(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a log of a driving robot (gzipped CARMEN) or of a standing lidar (ROS 1 bag)."""
    return (standing if path.suffix == ".bag" else driving)(path, predictor)


def driving(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a log of a robot that drives as far in a window as in the training (median).

    It drives as far as in ten scans if that is more.
    """
    log = read(path).crop(FOV)
    settings = spaced_by_distance(log, window_of(predictor), predictor.statistics)
    reach_m = min(log.range_max_m, REACH_M)
    for window in windows_of(log, path, predictor, settings, STRIDE):
        assert window.held_out, "the log is cropped"
        yield Case(window, reach_m, clear_of(window.held_out, predictor.grid, reach_m))


def read(path: Path) -> ScanLog:
    """Read a gzipped CARMEN log; the time of a scan is its number."""
    with gzip.open(path, "rt", encoding="utf-8", errors="replace") as lines:
        return collect(carmen_scans(lines, path), path, WindowSettings(spacing="distance"))


def standing(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a virtual lidar at the place of a standing one; others that it sweeps are held out."""
    settings = window_of(predictor)
    log = read_log(path, settings, ReadOptions(pose=(0.0, 0.0, 0.0)))
    virtual, beams = swinging(log)
    is_moving = log.ranges < np.median(np.nan_to_num(log.ranges, nan=np.inf, posinf=np.inf), axis=0) - NEARER_M
    reach_m, grid = min(log.range_max_m, REACH_M), predictor.grid
    first_s = log.stamps[0] + (predictor.steps - 1) * predictor.step_s
    for window in windows_of(virtual, path, predictor, settings, STANDING_STRIDE):
        number = int(np.searchsorted(log.stamps, window.stamp))
        ranges = np.where(np.isin(np.arange(len(log.angles)), beams), log.ranges[number], np.nan)
        ranges[beams[number]] = np.nan
        held_out, moving = (
            Scans(each[None], log.angles, np.array([[grid.size_m / 2, grid.size_m / 2, 0.0]]))
            for each in (ranges, np.where(is_moving[number], ranges, np.nan))
        )
        clear = clear_of(held_out, grid, reach_m)
        block = int((window.stamp - first_s) / BLOCK_S)
        yield Case(replace(window, held_out=held_out), reach_m, clear, observed(moving, grid, reach_m).hits, block)


def swinging(log: ScanLog) -> tuple[ScanLog, np.ndarray]:
    """Return the log of a virtual lidar that swings, and the beams of the log that it has, (S, N)."""
    spacing = float(np.diff(log.angles).mean())
    swing = SWING * np.sin(2 * np.pi * (log.stamps - log.stamps[0]) / PERIOD_S)
    turns = np.rint(swing / spacing).astype(int)  # in beams
    ahead = np.flatnonzero(np.abs(log.angles) <= FOV / 2)
    beams = ahead + turns[:, None]
    if not len(ahead) or beams.min() < 0 or beams.max() >= len(log.angles):
        raise InputError(f"expected a lidar of {2 * math.degrees(SWING + FOV / 2):g} degrees or more")
    poses = log.poses.copy()
    poses[:, 2] = turns * spacing
    ranges = np.take_along_axis(log.ranges, beams, axis=1)
    return replace(log, ranges=ranges, angles=log.angles[ahead], poses=poses), beams


def windows_of(
    log: ScanLog, path: Path, predictor: Predictor, settings: WindowSettings, stride: int
) -> Iterator[Window]:
    """Yield the windows of a log around their last poses, given the steps between them."""
    for window in cut(log, settings, stride * settings.step_s, predictor.grid.size_m):
        if isinstance(window, str):
            raise InputError(f"{path}: {window}")
        yield window


def clear_of(held_out: Scans, grid: Grid, range_max_m: float) -> Observed:
    """Return what held-out beams show of a map, (1, N), without passed pixels beside a hit."""
    scan = observed(held_out, grid, range_max_m)
    return Observed(scan.hits, scan.passed & ~maximum_filter(scan.hits, 3))
