"""Windows of real logs with the beams that their maps are compared with, see `repro.learning.held_out`.

Logs of driving robots are gzipped CARMEN files with poses corrected by a scan matcher. They have a scan every 0.5 to
1 m (freiburg-079: every 0.09 m), and some have lost their times. Therefore time counts scans. The time of a step is
such that the robot drives as far in a window as in the training, but at most ten steps have the same scan. The view is
90 degrees straight ahead.

The logs of Wean Hall are text with true times and the poses of odometry alone.

Floor plans have a simulated lidar and a known map, see `reproduce.real.floors`. No map is fitted to them.

Bags of a standing lidar have no poses. A view of 90 degrees swings by 45 degrees to both sides. The beams that are held
out are those that it sweeps and does not have at the end of the window.
"""

import gzip
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from repro.learning.held_out import View, labeled
from repro.logs.carmen import carmen_scans
from repro.logs.formats import read_log
from repro.logs.options import ReadOptions, WindowSettings, window_of
from repro.logs.scan_log import ScanLog, collect
from repro.maps.grid import Grid
from repro.networks.predictor import Predictor
from repro.prediction.agreement import Observed, observed
from repro.prediction.windows import Window, spaced_by_distance
from repro.system.errors import InputError
from reproduce.real import floors
from reproduce.real.evidence import Evidence
from reproduce.real.floors import is_floor

VIEW = View()
STRIDE, STANDING_STRIDE, FLOOR_STRIDE = 10, 5, 50  # steps between the ends of windows, of driving robots first
FOLDS = 3
PLACES = (  # in the order of the folds
    *("acapulco", "aces", "belgioioso", "csail", "edmonton", "fhw", "freiburg", "infinite", "intel", "orebro"),
    *("positive", "robotdata", "seattle"),
)
DEVELOPMENT = tuple(f"{name}-corrected.log.gz" for name in ("csail", "freiburg-079", "intel", "seattle"))
MAX_WINDOWS = 250  # of a log, evenly over it
NO_RETURN_CM = 8183.0  # and more, in a log of Wean Hall
WEAN_WORDS = 187  # of a scan
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
        shown: what held-out beams show where the truth is a whole floor; else None.
        block: number of the part of the log whose windows are drawn together.
    """

    window: Window
    range_max_m: float
    clear: Observed
    moving: np.ndarray | None = None
    shown: Observed | None = None
    block: int = 0

    @property
    def pixels(self) -> np.ndarray:
        """Return the flat indices of the pixels that held-out beams show, (P,)."""
        return np.flatnonzero(self.clear.hits | self.clear.passed)

    @property
    def free(self) -> np.ndarray:
        """Return whether the beams passed over each of these pixels, bool, (P,)."""
        return self.clear.passed.ravel()[self.pixels]

    def map_of(self, predictor: Predictor) -> np.ndarray:
        """Predict the probability of free, (H, W)."""
        limited = predictor.with_range(self.range_max_m)
        return limited.predict(self.window.scans, allow_empty=True)[0]

    def evidence(self, grid: Grid) -> Evidence:
        """Return what the window shows of its map."""
        return Evidence(self.window.scans, grid, self.range_max_m)

    def groups(self, seen: np.ndarray) -> dict[str, Observed]:
        """Return the pixels that are compared, by kind.

        Hits on what stands and on what moves are both compared with all passed pixels.

        Args:
            seen: whether a beam of the window has hit or passed over each of `pixels`, bool, (P,).
        """
        seen_at = np.zeros_like(self.clear.hits)
        seen_at.ravel()[self.pixels] = seen
        groups = {"all": self.clear, "seen": self.clear.within(seen_at), "unseen": self.clear.within(~seen_at)}
        if self.shown is not None:
            groups["shown"] = self.shown
        if self.moving is not None:
            for name, hits in (("standing", ~self.moving), ("moving", self.moving)):
                groups[name] = Observed(self.clear.hits & hits, self.clear.passed)
        return groups


def is_standing(path: Path) -> bool:
    """Return whether a log is a ROS 1 bag of a standing lidar, and not a gzipped CARMEN file of a driving robot."""
    return path.suffix == ".bag"


def kind_of(path: Path) -> str:
    """Return what the robot of a log does, as the tables call it."""
    return "simulated" if is_floor(path) else "stands" if is_standing(path) else "drives"


def place_of(path: Path) -> str:
    """Return the building or campus of a log, the first word of its name; logs of one place are never apart."""
    if is_floor(path):
        return "floors"
    return re.match("[a-z]+", path.name)[0]  # type: ignore[index]


def fold_of(path: Path) -> int | None:
    """Return the fold of a log, that of its place; a floor has none."""
    if is_floor(path):
        return None
    place = place_of(path)
    number = PLACES.index(place) if place in PLACES else int.from_bytes(place.encode(), "big")
    return number % FOLDS


def check(paths: list[Path], networks: list[str]) -> None:
    """Check that there are logs from which others can be kept apart.

    Raises:
        InputError: there is no network, a path is no log or floor, or all logs are of one fold.
    """
    if not networks:
        raise InputError("expected --adapted WEIGHTS or --weights WEIGHTS ..., got no network")
    for path in paths:
        if not (is_floor(path) or path.is_file()):
            raise InputError(f"{path}: expected a log, or the directory of a floor with {floors.PLAN}, got neither")
    folds = {fold_of(path) for path in paths} - {None}
    if len(folds) < 2:
        raise InputError(
            f"expected logs of two of {FOLDS} folds or more, since maps are fitted to other logs than the tested ones, "
            f"got those of {len(folds)}"
        )


def cases_of(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a log of a driving robot, of one of a standing lidar (ROS 1 bag), or of a floor."""
    return {"simulated": on_floor, "stands": standing, "drives": driving}[kind_of(path)](path, predictor)


def driving(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a log of a robot that drives as far in a window as in the training (median).

    It drives as far as in ten scans if that is more.
    """
    log, settings = log_of(path, predictor)
    for window, clear in labeled(log, settings, stride_of(log, settings, STRIDE), predictor.grid, VIEW):
        yield Case(window, min(log.range_max_m, VIEW.range_max_m), clear)


def on_floor(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a simulated drive through a floor plan."""
    settings = window_of(predictor)
    for window, known, shown in floors.windows(path, settings, FLOOR_STRIDE, predictor.grid, VIEW):
        yield Case(window, VIEW.range_max_m, known, shown=shown)


def stride_of(log: ScanLog, settings: WindowSettings, least: float) -> float:
    """Return the steps between the ends of two windows, of which there are `MAX_WINDOWS` at most."""
    steps = (log.stamps[-1] - log.stamps[0] - settings.duration_s) / settings.step_s
    return max(least, steps / MAX_WINDOWS)


def log_of(path: Path, predictor: Predictor) -> tuple[ScanLog, WindowSettings]:
    """Read a gzipped CARMEN log, whose scans are spaced by distance, a log of Wean Hall, or a bag."""
    settings = window_of(predictor)
    if is_standing(path):
        return read_log(path, settings, ReadOptions(pose=(0.0, 0.0, 0.0))), settings
    if path.suffix != ".gz":
        return wean_hall(path), settings
    try:
        with gzip.open(path, "rt", encoding="utf-8", errors="replace") as lines:
            log = collect(carmen_scans(lines, path), path, WindowSettings(spacing="distance"))
    except (EOFError, gzip.BadGzipFile) as error:
        raise InputError(f"{path}: expected a gzipped CARMEN file, got a damaged one ({error})") from error
    return log, spaced_by_distance(log, settings, predictor.statistics)


def wean_hall(path: Path) -> ScanLog:
    """Read a log of Wean Hall: lines of `L`, poses of robot and lidar, 180 ranges of half a turn [cm, rad], time."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    rows = [line.split()[1:] for line in lines if line.startswith("L ")]
    if not rows or {len(row) for row in rows} != {WEAN_WORDS}:
        raise InputError(
            f"{path}: expected a log of Wean Hall, lines of L and {WEAN_WORDS} numbers (CARMEN files are gzipped here)"
        )
    table = np.array(rows, float)
    ranges = np.where(table[:, 6:-1] < NO_RETURN_CM, table[:, 6:-1] / 100, np.inf).astype(np.float32)
    poses = table[:, 3:6] * [0.01, 0.01, 1]
    poses[:, 2] = np.unwrap(poses[:, 2])
    angles = np.radians(np.arange(ranges.shape[1]) - 89.5)
    return ScanLog(table[:, -1], ranges, angles, poses, range_max_m=NO_RETURN_CM / 100)


def standing(path: Path, predictor: Predictor) -> Iterator[Case]:
    """Yield the windows of a log of a standing lidar, with the pixels of what moves."""
    (log, settings), grid = log_of(path, predictor), predictor.grid
    is_moving = log.ranges < np.median(np.nan_to_num(log.ranges, nan=np.inf, posinf=np.inf), axis=0) - NEARER_M
    reach_m = min(log.range_max_m, VIEW.range_max_m)
    first_s = log.stamps[0] + (predictor.steps - 1) * predictor.step_s
    for window, clear in labeled(log, settings, stride_of(log, settings, STANDING_STRIDE), grid, VIEW):
        assert window.held_out, "the lidar sees beyond the view"
        number = int(np.searchsorted(log.stamps, window.stamp))
        moving = replace(window.held_out, ranges=np.where(is_moving[number], window.held_out.ranges, np.nan))
        block = int((window.stamp - first_s) / BLOCK_S)
        yield Case(window, reach_m, clear, observed(moving, grid, reach_m).hits, block=block)
