"""A log of a robot: scans with their times and poses, checked scan by scan; what cannot be used is counted."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from repro.logs.log_scan import LogScan
from repro.logs.options import WindowSettings
from repro.logs.readings import check_heading
from repro.logs.reasons import Reason
from repro.logs.scan_filter import ScanFilter
from repro.logs.times import Clock, UnusableTimes, between_scans_s, parts_of
from repro.maps.validity import RADIANS, jumps
from repro.scans import wrapped
from repro.system.errors import InputError
from repro.system.memory import available_memory_gb

MIN_SCANS = 2
MAX_BETWEEN_S = 30.0  # between two scans of a lidar
MAX_UNORDERED = 10  # some logs have times of six digits, which hardly increase
BY_NUMBER = "use prediction.spacing=distance"
SCANS_PER_CHECK = 1000  # of the memory


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
        notes: what is wrong with the readings, such as misses that are none.
    """

    stamps: np.ndarray
    ranges: np.ndarray
    angles: np.ndarray
    poses: np.ndarray
    skipped: dict[Reason, int] = field(default_factory=dict)
    range_max_m: float = math.inf
    uncropped: "ScanLog | None" = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)

    def check_times(self, settings: WindowSettings) -> None:
        """Check that the scans have windows; a refusal names what was left out, too.

        Raises:
            InputError: the scans are too rare for the steps, no part without a gap is as long as a window, or the
                times are not in seconds.
        """
        left_out = ", ".join(f"{count} {reason}" for reason, count in self.skipped.items())
        skipped = f" (skipped: {left_out})" if left_out else ""
        between_s, longest_s = between_scans_s(self.stamps), settings.longest_gap_s
        is_spaced = settings.spacing == "distance"
        if between_s > MAX_BETWEEN_S:
            raise UnusableTimes(
                f"a scan every {between_s:.3g} s: expected times in seconds, not in ms, us or ns{skipped}"
            )
        if between_s > longest_s:
            if is_spaced:
                raise InputError(f"{settings.steps} steps are too many for windows of {settings.duration_s:.0f} scans")
            needed = f"steps of {settings.step_s:g} s need one every {longest_s:.3g} s{skipped}"
            raise UnusableTimes(f"a scan every {between_s:.2g} s, {needed}: {BY_NUMBER}, or another prediction.step_s")
        parts = parts_of(self.stamps, settings)
        longest = max(float(self.stamps[end - 1] - self.stamps[begin]) for begin, end in parts)
        if not settings.is_filled(0.0, longest):
            without = " without a gap" if len(parts) > 1 else ""
            has, takes = f"{longest:.1f} s of scans{without}", f"{settings.duration_s:.1f} s"
            if is_spaced:
                has, takes = f"{len(self)} scans", f"{settings.duration_s:.0f}, a path as long as in training"
            raise InputError(f"the log has {has}, a window of {settings.steps} steps takes {takes}{skipped}")

    def crop(self, fov_rad: float) -> "ScanLog":
        """Return the log with the beams within a field of view around straight ahead; `held_out` has the others.

        Raises:
            InputError: fewer than two beams are within it, or the lidar does not see a part of it.
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
        """Return the beams that the crop removed from a scan, given its number; None if the log was not cropped.

        Returns:
            ranges [m], (1, M), of all beams before the crop, NaN for those that it kept, and their angles [rad], (M,).
        """
        if self.uncropped is None:
            return None
        angles, ranges = self.uncropped.angles, self.uncropped.ranges[index : index + 1]
        ahead = wrapped(angles)
        kept = (ahead >= self.angles[0]) & (ahead <= self.angles[-1])
        return np.where(kept, np.nan, ranges), angles


def collect(scans: Iterable[LogScan], path: Path, settings: WindowSettings) -> ScanLog:
    """Check the scans of a log one by one and keep those that can be used.

    Args:
        scans: the scans, in the order of their times.
        path: the log, for messages.
        settings: the windows that will be cut from it: their steps choose the scans, their maximum range replaces that
            of the scans, and if they are spaced by distance, times are the numbers of the scans.

    Raises:
        InputError: the times do not order the scans, fewer than two scans can be used, the beams are not those of a
            lidar, the ranges are not meters, or the headings are not radians.
    """
    scan_filter, clock = ScanFilter(str(path), settings), Clock(settings)
    kept = list[LogScan]()
    for number, scan in enumerate(_usable(scans, scan_filter)):
        if settings.spacing == "distance":
            kept.append(replace(scan, stamp=float(number)))
        elif not clock.why_left_out(scan.stamp):
            if clock.replaces:
                kept.pop()
            kept.append(scan)
        is_checked = len(kept) % SCANS_PER_CHECK == 0
        if is_checked and 1e-9 * sum(scan.ranges.nbytes for scan in kept) > available_memory_gb():  # copied once
            raise InputError(f"{path}: its first {number} scans fill the memory: divide the log")
    stamps = np.array([scan.stamp for scan in kept])
    _check_order(stamps, clock.left_out[Reason.NOT_LATER] + clock.left_out[Reason.OUT_OF_ORDER], path)
    skipped = scan_filter.left_out + clock.left_out
    if len(kept) < MIN_SCANS:
        reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        raise InputError(f"{path}: {len(kept)} scans can be used ({reasons or 'it has no others'}): need {MIN_SCANS}")
    ranges, poses = np.stack([scan.ranges for scan in kept]), np.array([scan.pose for scan in kept], float)
    notes, range_max_m = tuple(scan_filter.notes.values()), scan_filter.range_max_m
    log = ScanLog(stamps, ranges, scan_filter.angles, poses, dict(skipped), range_max_m, notes=notes)
    _check_values(log, path, frames={getattr(scan.header, "frame_id", None) for scan in kept})
    log.poses[:, 2] = np.unwrap(log.poses[:, 2])
    return log


def _usable(scans: Iterable[LogScan], scan_filter: ScanFilter) -> Iterator[LogScan]:
    for scan in scans:
        yield from scan_filter.add(scan)
    yield from scan_filter.flush()


def _check_order(stamps: np.ndarray, unordered: int, path: Path) -> None:
    """Refuse times where most scans are not later than the one before, or that go back again and again."""
    backward = int((np.diff(stamps) < 0).sum())
    lost = f"its times are lost, or its scans are not in the order of their times: {BY_NUMBER}"
    if unordered > MAX_UNORDERED * len(stamps):
        counts = f"{unordered} scans are {Reason.NOT_LATER}, {len(stamps)} are later"
        raise UnusableTimes(f"{path}: {counts}: {lost}")
    if backward >= MAX_UNORDERED:
        raise UnusableTimes(f"{path}: time goes back by more than a window {backward} times: {lost}")


def _check_values(log: ScanLog, path: Path, frames: set[str | None]) -> None:
    """Refuse a log without headings in radians; those of several lidars on one topic jump."""
    check_heading(float(np.abs(log.poses[:, 2]).max()), f"{path}: the headings look")
    if len(frames) == 1 and jumps(log.poses[:, 2]):
        raise InputError(f"{path}: the headings look like degrees, they jump from scan to scan: {RADIANS}")


def path_m(poses: np.ndarray) -> float:
    """Return the length of a path [m], given its poses, (S, 3)."""
    return float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())
