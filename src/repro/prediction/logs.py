"""A log of a robot: scans with their times and poses, checked scan by scan; what cannot be used is counted."""

import logging
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from repro.maps.validity import RADIANS, jumps
from repro.prediction.intake import Intake, LogScan, in_order, valid_ranges
from repro.prediction.readings import check_heading, note_on_changes, note_on_far_hits
from repro.prediction.times import NOT_LATER, Clock, Kept, TimesLost, WindowSettings, check_times
from repro.scans import wrapped
from repro.system.errors import InputError
from repro.system.memory import available_memory_gb

LOGGER = logging.getLogger(__name__)
MIN_SCANS = 2
MOSTLY = 10  # some logs have times of six digits, which hardly increase
MAX_MEDIAN_M = 300.0  # median range beyond which no 2D lidar measures; the readings are in other units
Pose = tuple[float, float, float]
ROWS_PER_CHECK = 1000  # of the memory


@dataclass(frozen=True)
class ReadOptions:
    """What a user knows of a log that its file does not say.

    Args:
        scan_topic: topic of the scans in a bag; None to find it.
        odometry_topic: topic of the odometry in a bag; None to find it.
        frame: frame of the poses in a bag, such as `odom`; None for the topmost one.
        pose: x, y [m] and heading [rad] of a lidar that stands; None for the poses of the log.
        mounting: x, y [m] and heading [rad] of the lidar on the robot; None for that of the log, in which the poses of
            an npz or a CARMEN log are those of the lidar.
    """

    scan_topic: str | None = None
    odometry_topic: str | None = None
    frame: str | None = None
    pose: Pose | None = None
    mounting: Pose | None = None

    def __post_init__(self) -> None:
        others = {"frame": self.frame, "mounting": self.mounting, "odometry_topic": self.odometry_topic}
        unused = [name for name, value in others.items() if value is not None]
        if self.pose is not None and unused:
            raise InputError(f"pose: a lidar that stands needs no {' or '.join(unused)}: leave one out")


@dataclass(frozen=True)
class ScanLog:
    """The usable scans of a log, in the order of time.

    Args:
        stamps: times [s], (S,), increasing.
        ranges: ranges [m], (S, N), float32; a miss is inf, an invalid reading NaN.
        angles: beam angles in the frame of the lidar [rad], (N,), increasing.
        poses: x, y [m] and heading [rad] of the lidar, (S, 3).
        skipped: number of scans that were left out, by reason.
        range_max_m: smallest range that means a miss [m].
        uncropped: the log before `crop`; None if it was not cropped.
    """

    stamps: np.ndarray
    ranges: np.ndarray
    angles: np.ndarray
    poses: np.ndarray
    skipped: dict[str, int] = field(default_factory=dict)
    range_max_m: float = math.inf
    uncropped: "ScanLog | None" = None

    def __len__(self) -> int:
        return len(self.stamps)

    def check_times(self, settings: WindowSettings) -> None:
        """Check that the scans have windows, see `times.check_times`; a refusal names what was left out, too."""
        try:
            check_times(self.stamps, settings)
        except InputError as error:
            left_out = ", ".join(f"{count} {reason}" for reason, count in self.skipped.items())
            raise type(error)(f"{error} (skipped: {left_out})" if left_out else str(error)) from error

    def crop(self, fov_rad: float) -> "ScanLog":
        """Return the log with the beams within a field of view around straight ahead; `held_out` has the others.

        Raises:
            ValueError: fewer than two beams are within it, or the lidar does not see a part of it.
        """
        ahead = wrapped(self.angles)
        inside = np.flatnonzero(np.abs(ahead) <= fov_rad / 2 + 1e-6)
        if len(inside) < 2:
            raise InputError(f"{len(inside)} beams are within {math.degrees(fov_rad):.1f} degrees: use a larger one")
        inside = inside[np.argsort(ahead[inside])]
        gaps = np.diff(ahead[inside])
        if gaps.max() > 1.5 * np.median(gaps):
            begin, end = np.degrees(ahead[inside][[gaps.argmax(), gaps.argmax() + 1]])
            raise InputError(
                f"the lidar has no beams between {begin:.1f} and {end:.1f} degrees: expected a field of view around "
                f"straight ahead that it sees, got {math.degrees(fov_rad):.1f} degrees"
            )
        uncropped = self if len(inside) < len(ahead) else None
        ranges = np.ascontiguousarray(self.ranges[:, inside])
        return replace(self, ranges=ranges, angles=ahead[inside], uncropped=uncropped)

    def held_out(self, index: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return a scan of the beams that the crop removed.

        Args:
            index: number of the scan.

        Returns:
            ranges [m], (1, M), of all beams before the crop, NaN for those that it kept, and their angles [rad], (M,);
            None if the log was not cropped.
        """
        if self.uncropped is None:
            return None
        angles, ranges = self.uncropped.angles, self.uncropped.ranges[index : index + 1]
        ahead = wrapped(angles)
        kept = (ahead >= self.angles[0]) & (ahead <= self.angles[-1])
        return np.where(kept, np.nan, ranges), angles


def collect(scans: Iterable[LogScan], path: Path, settings: WindowSettings) -> ScanLog:
    """Check the scans of a log one by one and keep those that can be used.

    What an `Intake` and a `Clock` leave out is counted. If the maximum range changes, the log has the smallest, and a
    message says so. If the windows are spaced by distance, the time of a scan is its number.

    Args:
        scans: the scans in the order of the file.
        path: the file, for messages.
        settings: windows that will be cut from the log.

    Raises:
        TimesLost: the times do not order the scans.
        InputError: fewer than two scans can be used, the beams are not those of a lidar, the ranges are not meters, or
            the headings are not radians.
    """
    intake, clock = Intake(str(path), settings.range_max_m), Clock[LogScan](settings)
    far: Counter[float] = Counter()
    usable = _with_far_readings(_usable(scans, intake), far)
    kept = _numbered(usable) if settings.spacing == "distance" else _kept(usable, clock)
    rows, range_max_m = _rows(kept, intake, path)
    _check_order(rows, clock, path)
    skipped = intake.left_out + clock.left_out
    if intake.first is None or len(rows) < MIN_SCANS:
        reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        raise InputError(f"{path}: {len(rows)} scans can be used ({reasons or 'it has no others'}): need {MIN_SCANS}")
    _check_values(rows, path)
    for note in (note_on_changes(range_max_m), note_on_far_hits(far, float(range_max_m.min()))):
        if note:
            LOGGER.warning("%s: %s", path, note)
    angles, index = in_order(intake.first)
    poses = rows["pose"].copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    ranges = np.ascontiguousarray(rows["ranges"][:, index])
    return ScanLog(rows["stamp"].copy(), ranges, angles, poses, dict(skipped), float(range_max_m.min()))


def _usable(scans: Iterable[LogScan], intake: Intake) -> Iterator[LogScan]:
    for scan in scans:
        yield from intake.take(scan)
    yield from intake.flush()


def _with_far_readings(scans: Iterator[LogScan], far: Counter[float]) -> Iterator[LogScan]:
    """Yield the scans, and count some of the readings beyond their maximum range [m] by value."""
    for scan in scans:
        beyond = scan.ranges[np.isfinite(scan.ranges) & (scan.ranges >= scan.range_max_m)]
        far.update(np.round(beyond[:: max(1, len(beyond) // 10)], 2).tolist())
        yield scan


def _kept(scans: Iterator[LogScan], clock: Clock[LogScan]) -> Iterator[Kept[LogScan]]:
    for scan in scans:
        yield from clock.take(scan.stamp, scan)


def _numbered(scans: Iterator[LogScan]) -> Iterator[Kept[LogScan]]:
    for number, scan in enumerate(scans):
        yield Kept(float(number), scan, begins=not number)


def _rows(kept: Iterator[Kept[LogScan]], intake: Intake, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the stamps, ranges and poses of the kept scans as one structured array, and their maximum ranges [m]."""
    first = next(kept, None)
    count = len(intake.first.ranges) if intake.first and first else 0
    kind = np.dtype([("stamp", "f8"), ("ranges", "f4", (count,)), ("pose", "f8", (3,))])
    limits: list[float] = []

    def values() -> Iterator[tuple[float, np.ndarray, tuple[float, float, float] | None]]:
        scans = [first] if first else []
        for part in (scans, kept):
            for each in part:
                if len(limits) % ROWS_PER_CHECK == 0:  # growing doubles the array, and a copy in order follows
                    needed_gb = 2 * (len(limits) + ROWS_PER_CHECK) * kind.itemsize / 1e9
                    if needed_gb > available_memory_gb() + len(limits) * kind.itemsize / 1e9:
                        raise InputError(f"{path}: its first {len(limits)} scans fill the memory: divide the log")
                limits.append(each.scan.range_max_m)
                yield each.stamp, valid_ranges(each.scan), each.scan.pose

    return np.fromiter(values(), kind), np.array(limits)


def _check_values(rows: np.ndarray, path: Path) -> None:
    """Check that the rows of a log have ranges in meters and headings in radians.

    Raises:
        InputError: they do not.
    """
    sample = rows["ranges"][:: max(1, len(rows) // 1000)]
    finite = sample[np.isfinite(sample)]
    if len(finite) and np.median(finite) > MAX_MEDIAN_M:
        raise InputError(f"{path}: the median range is {np.median(finite):.0f}: expected meters")
    check_heading(float(np.abs(rows["pose"][:, 2]).max()), f"{path}: the headings look")
    if jumps(torch.as_tensor(rows["pose"][:, 2].copy())):
        raise InputError(f"{path}: the headings look like degrees, they jump from scan to scan: {RADIANS}")


def _check_order(rows: np.ndarray, clock: Clock[LogScan], path: Path) -> None:
    """Check that the times order the scans of a log.

    Raises:
        TimesLost: most scans are not later than the one before, or time goes back again and again.
    """
    backward = int((np.diff(rows["stamp"]) < 0).sum())
    lost = "its times are lost, or its scans are not in the order of their times"
    if clock.left_out[NOT_LATER] > MOSTLY * len(rows):
        counts = f"{clock.left_out[NOT_LATER]} scans are {NOT_LATER}, {len(rows)} are later"
        raise TimesLost(f"{path}: {counts}: {lost}")
    if backward >= MOSTLY:
        raise TimesLost(f"{path}: time goes back by more than a window {backward} times: {lost}")
