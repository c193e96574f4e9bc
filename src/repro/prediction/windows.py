"""Windows of a log: as many steps as the network was trained with, at its step time, moved onto its map."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from repro.prediction.logs import ScanLog
from repro.scans import Scans, wrapped
from repro.system.errors import InputError

MOST_BETWEEN_S = 30.0  # between two scans of a lidar
MAX_AGE_STEPS = 5  # of the scan that stands in for a step; a larger gap leaves out the window


def longest_gap_s(step_s: float) -> float:
    """Return the time between two scans beyond which no window has both [s], given the time of a step [s]."""
    return 2 * MAX_AGE_STEPS * step_s + 1e-6


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


def cut(
    log: ScanLog, *, steps: int, step_s: float, stride_s: float, center: str | tuple[float, float], size_m: float
) -> Iterator[Window | str]:
    """Cut a log into windows, each of which ends with the scan nearest to `stride_s` after the one before.

    Each other step takes the scan nearest in time. A gap that no window can bridge divides the log: the first window
    after it begins with the scan after the gap.

    Args:
        log: the log.
        steps: steps of a window, T.
        step_s: time of a step [s].
        stride_s: time between two windows [s].
        center: center of the map: `start` (the first pose of the log), `robot` (the last pose of the window), or x, y
            in the frame of the log [m].
        size_m: side of the map [m].

    Yields:
        the windows, and for each one that cannot be used, each gap and each part that is too short, the reason.

    Raises:
        ValueError: the center is another word, no part of the log is as long as one window, or its scans are too rare
            for steps of `step_s`.
    """
    if isinstance(center, str) and center not in ("start", "robot"):
        raise InputError(f"center: expected start, robot or x, y [m], got {center}")
    length, longest_gap = (steps - 1) * step_s, longest_gap_s(step_s)
    gaps = np.diff(log.stamps)
    begins = np.flatnonzero(gaps > longest_gap) + 1
    parts = np.split(log.stamps, begins)
    _check_times(gaps, parts, steps, step_s)
    number = 0
    for begin, stamps in zip((0, *begins), parts, strict=True):
        if begin:
            yield f"no scans for {gaps[begin - 1]:.1f} s before {stamps[0]:.2f} s"
        duration = float(stamps[-1] - stamps[0])
        if duration < length - step_s / 2:
            yield f"{duration:.1f} s of scans from {stamps[0]:.2f} s, a window takes {length:.1f} s"
            continue
        for end in _ends(stamps, length, stride_s, step_s):
            number += 1
            try:
                index = begin + steps_before(stamps, end, steps=steps, step_s=step_s)
            except InputError as error:
                yield str(error)
                continue
            origin = _center(center, log, index[-1]) - size_m / 2
            last = index[-1] + 1
            following = _on_map(log, slice(last, last + 1), origin) if last < begin + len(stamps) else None
            corner = (float(origin[0]), float(origin[1]))
            held_out = _held_out(log, last - 1, origin)
            yield Window(number, float(end), _on_map(log, index, origin), corner, following, held_out)


def _check_times(gaps: np.ndarray, parts: list[np.ndarray], steps: int, step_s: float) -> None:
    """Check that scans with these times between them [s], in parts (S,) without a gap, have windows."""
    length, longest_gap, between_s = (steps - 1) * step_s, longest_gap_s(step_s), float(np.median(gaps))
    if between_s > MOST_BETWEEN_S:
        raise InputError(f"the log has a scan every {between_s:.3g} s: expected times in seconds, not in ms or ns")
    if between_s > longest_gap:
        raise InputError(
            f"the log has a scan every {between_s:.2g} s, steps of {step_s:g} s need one every {longest_gap:g} s: "
            f"use prediction.step_s={between_s:.2g}"
        )
    longest = max(float(stamps[-1] - stamps[0]) for stamps in parts)
    if longest < length - step_s / 2:
        without = " without a gap" if len(parts) > 1 else ""
        raise InputError(
            f"the log has {longest:.1f} s of scans{without}, a window of {steps} steps takes {length:.1f} s"
        )


def _ends(stamps: np.ndarray, length: float, stride_s: float, step_s: float) -> np.ndarray:
    """Return the times of the scans that end the windows of a part without a gap [s], given the length of a window [s].

    They are those nearest to every `stride_s`, and each at most once; the first may be half a step early.
    """
    count = int(max(stamps[-1] - stamps[0] - length, 0) / stride_s + 1e-6) + 1
    wanted = stamps[0] + length + stride_s * np.arange(count)
    late_enough = stamps[stamps - stamps[0] >= length - step_s / 2]
    return np.unique(late_enough[_nearest(late_enough, wanted)])


def steps_before(stamps: np.ndarray, end: float, *, steps: int, step_s: float) -> np.ndarray:
    """Return the index of the scan nearest in time to each step of a window.

    Args:
        stamps: times of the scans [s], (S,), increasing.
        end: time of the last step [s].
        steps: steps of the window, T.
        step_s: time of a step [s].

    Returns:
        the indices, (T,), oldest step first.

    Raises:
        ValueError: the window begins before the first scan, or a step has no scan within `MAX_AGE_STEPS` steps.
    """
    times = end - step_s * np.arange(steps - 1, -1, -1)
    if stamps[0] - times[0] > (0.5 + 1e-6) * step_s:
        raise InputError(f"scans of {end - stamps[0]:.1f} s before {end:.2f} s, a window takes {end - times[0]:.1f} s")
    index = _nearest(stamps, times)
    gap = np.abs(stamps[index] - times).max()
    if gap > MAX_AGE_STEPS * step_s:
        raise InputError(f"no scan for {gap:.1f} s before {end:.2f} s")
    return index


def on_map(ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray, origin: np.ndarray) -> Scans:
    """Return a window whose poses are moved from the frame of a log onto a map.

    Args:
        ranges: ranges [m], (T, N).
        angles: beam angles [rad], (N,).
        poses: x, y [m] and heading [rad] in the frame of the log, (T, 3).
        origin: x, y of the lower left corner of the map in the frame of the log [m], (2,).
    """
    poses = poses.copy()
    poses[:, :2] -= origin
    poses[:, 2] = wrapped(poses[:, 2])
    return Scans(np.ascontiguousarray(ranges), angles, poses)


def _nearest(stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
    if len(stamps) == 1:
        return np.zeros(len(times), dtype=int)
    after = np.searchsorted(stamps, times).clip(1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] <= stamps[after] - times, after - 1, after)


def _center(center: str | tuple[float, float], log: ScanLog, last: int) -> np.ndarray:
    if isinstance(center, str):
        return log.poses[{"start": 0, "robot": last}[center], :2]
    return np.array(center, dtype=float)


def _on_map(log: ScanLog, index: np.ndarray | slice, origin: np.ndarray) -> Scans:
    return on_map(log.ranges[index], log.angles, log.poses[index], origin)


def _held_out(log: ScanLog, index: int, origin: np.ndarray) -> Scans | None:
    scan = log.held_out(index)
    return on_map(*scan, log.poses[index : index + 1], origin) if scan else None
