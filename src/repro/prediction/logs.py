"""A log of a robot: scans with their times and poses, checked scan by scan; what cannot be used is counted."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, islice, pairwise
from pathlib import Path

import numpy as np
import torch

from repro.maps.validity import RADIANS, jumps
from repro.prediction.readings import (
    NOT_LATER,
    WITHOUT_BEAMS,
    WITHOUT_POSE,
    LogScan,
    check_beams,
    check_heading,
    has_same_beams,
    has_valid_range,
    in_order,
    note_on_changes,
    readings,
    valid_ranges,
    why_unusable,
)
from repro.scans import wrapped
from repro.system.errors import InputError

MIN_SCANS = 2
MOSTLY = 10  # some logs have times of six digits, which hardly increase
SET_BACK_S, SET_BACK = 10.0, "before or after the clock was set back"  # a time earlier than the last one by more
ISOLATED = f"more than {SET_BACK_S:g} s away from the scans before and after"
HEAD = 20  # scans of which most have the beams of the log
MILLIMETERS = 300.0  # median range [m] beyond which no 2D lidar measures; the readings are in other units


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

    def with_range(self, range_max_m: float) -> "ScanLog":
        """Return the log of a lidar with this maximum range [m], from which on a reading is a miss."""
        uncropped = self.uncropped.with_range(range_max_m) if self.uncropped else None
        ranges = readings(self.ranges, 0.0, range_max_m)
        return replace(self, ranges=ranges, range_max_m=range_max_m, uncropped=uncropped)

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


def collect(scans: Iterable[LogScan], path: Path, spacing_s: float) -> ScanLog:
    """Check the scans of a log one by one and keep those that can be used.

    A scan is skipped if its time is not after that of the last one, after it by less than `spacing_s`, or far from
    those of both neighbors, and if it has no pose, no valid maximum range, no valid reading, or other beams than most
    of the first ones. If the clock was set back, the longest part of the log without such a jump is kept. If the
    maximum range changes, the log has the smallest, and a message says so.

    Args:
        scans: the scans in the order of the file.
        path: the file, for messages.
        spacing_s: smallest time between two scans that are kept [s].

    Raises:
        ValueError: no two scans can be used, the beams are not those of a lidar, the ranges are not meters, or the
            headings are not radians.
    """
    skipped: Counter[str] = Counter()
    usable = _usable(scans, path, spacing_s, skipped)
    first = next(usable, None)
    count = len(first.ranges) if first else 0
    kind = np.dtype([("stamp", "f8"), ("ranges", "f4", (count,)), ("pose", "f8", (3,)), ("range_max", "f8")])
    scans = chain([first] if first else [], usable)
    rows = ((scan.stamp, valid_ranges(scan), scan.pose, scan.range_max_m) for scan in scans)
    kept = np.fromiter(rows, kind)  # grows in place: a log may be half as large as the memory
    kept = _longest_part(kept, path, skipped)
    if first is None or len(kept) < MIN_SCANS:
        reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        raise InputError(f"{path}: {len(kept)} scans can be used ({reasons or 'it has no others'}): need {MIN_SCANS}")
    _check_values(kept, path, skipped)
    if message := note_on_changes(kept["range_max"]):
        print(f"{path}: {message}", flush=True)
    angles, ranges = in_order(first.first_angle + first.spacing * np.arange(count), kept["ranges"])
    poses = kept["pose"].copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    return ScanLog(kept["stamp"].copy(), ranges, angles, poses, dict(skipped), float(kept["range_max"].min()))


def _usable(scans: Iterable[LogScan], path: Path, spacing_s: float, skipped: Counter[str]) -> Iterator[LogScan]:
    scans = _placed(scans, skipped)  # a lidar without a pose may be upside down: its angles are not known
    head = list(islice(scans, HEAD))
    first = _with_most_frequent_beams(head)
    if first:
        check_beams(first, str(path))
    last = -math.inf
    for scan in _without_wrong_times(chain(head, scans), skipped):
        if scan.stamp < last - SET_BACK_S:
            last = -math.inf
        reason = why_unusable(scan, first, last)
        if not reason and scan.stamp - last < spacing_s:
            reason = f"less than {spacing_s:.3g} s after the one before"
        if reason:
            skipped[reason] += 1
        else:
            last = scan.stamp
            yield scan


def _placed(scans: Iterable[LogScan], skipped: Counter[str]) -> Iterator[LogScan]:
    """Yield the scans that have beams and a pose."""
    for scan in scans:
        if not len(scan.ranges):
            skipped[WITHOUT_BEAMS] += 1
        elif scan.pose is None:
            skipped[WITHOUT_POSE] += 1
        else:
            yield scan


def _without_wrong_times(scans: Iterable[LogScan], skipped: Counter[str]) -> Iterator[LogScan]:
    """Yield the scans without those whose time is far from that of both neighbors."""
    last = -math.inf
    for scan, following in pairwise(chain(scans, [None])):
        assert scan is not None, "only the last"
        continues = following is not None and 0 <= following.stamp - last <= SET_BACK_S
        if continues and abs(scan.stamp - last) > SET_BACK_S:
            skipped[ISOLATED] += 1
        else:
            last = scan.stamp
            yield scan


def _check_values(kept: np.ndarray, path: Path, skipped: Counter[str]) -> None:
    """Check that the rows of a log have times that increase, ranges in meters and headings in radians.

    Raises:
        ValueError: they do not.
    """
    if skipped[NOT_LATER] > MOSTLY * len(kept):
        counts = f"{skipped[NOT_LATER]} scans are {NOT_LATER}, {len(kept)} are later"
        raise InputError(f"{path}: {counts}: its times are lost, or its scans are not in the order of their times")
    sample = kept["ranges"][:: max(1, len(kept) // 1000)]
    finite = sample[np.isfinite(sample)]
    if len(finite) and np.median(finite) > MILLIMETERS:
        raise InputError(f"{path}: the median range is {np.median(finite):.0f}: expected meters")
    check_heading(float(np.abs(kept["pose"][:, 2]).max()), f"{path}: the headings look")
    if jumps(torch.as_tensor(kept["pose"][:, 2].copy())):
        raise InputError(f"{path}: the headings look like degrees, they jump from scan to scan: {RADIANS}")


def _with_most_frequent_beams(scans: list[LogScan]) -> LogScan | None:
    """Return the first of the scans that have the most frequent beams, if possible one with a valid maximum range.

    None is returned if no scan has beams.
    """
    with_beams = [each for each in scans if len(each.ranges)]
    with_beams = [each for each in with_beams if has_valid_range(each)] or with_beams
    return max(with_beams, key=lambda each: sum(has_same_beams(each, other) for other in with_beams), default=None)


def _longest_part(kept: np.ndarray, path: Path, skipped: Counter[str]) -> np.ndarray:
    """Return the longest part of the rows of a log in which time does not go back; the others are counted.

    Raises:
        ValueError: time goes back too often for a clock that is set.
    """
    parts = np.split(kept, np.flatnonzero(np.diff(kept["stamp"]) < 0) + 1)
    if len(parts) > MOSTLY:
        raise InputError(
            f"{path}: time goes back by more than {SET_BACK_S:g} s {len(parts) - 1} times: its times are lost, or its "
            "scans are not in the order of their times"
        )
    longest = max(parts, key=len)
    if len(longest) < len(kept):
        skipped[SET_BACK] += len(kept) - len(longest)
    return longest
