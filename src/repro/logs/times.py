"""The times of scans and the steps of windows: one set of rules for logs, streams and nodes.

A `Clock` chooses scans by their times, as they arrive, `WindowSettings.divides` finds the parts of the kept scans, and
`steps_before` takes the scan nearest to each step of a window. Logs, streams and nodes use them, so that they predict
the same maps.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from repro.networks.predictor import Predictor
from repro.system.errors import InputError

MAX_AGE_STEPS = 5  # of the scan that stands in for a step; twice that between two scans divides a log
MAX_STEPS = 10_000  # of a window
MIN_STEP_S = 0.001  # far above the resolution of times, so that a window has as many scans as steps
TOLERANCE = 1e-4  # of a step; times since 1970 in float64 are exact to 2e-7 s
SPACINGS = ("time", "distance")
MISSES = ("free", "invalid")
NOT_LATER = "not later than the one before"
TOO_SOON = "less than half a step after the one before"
OUT_OF_ORDER = "with a time out of order"


class UnusableTimes(InputError):
    """Times of scans that are lost, or too rare for the steps of windows; the scans may be spaced by distance."""


@dataclass(frozen=True)
class WindowSettings:
    """How windows are cut from scans.

    Args:
        center: center of the map: `robot` (the last pose of the window), `start` (the first pose of a log), or x, y in
            the frame of the poses [m].
        steps: steps of a window, T.
        step_s: time of a step [s]; with `distance`, scans between two steps.
        range_max_m: maximum range of the lidar [m], which replaces that of the scans; None keeps it.
        misses: `free`: a miss shows free space; or `invalid`: it shows nothing, as of lost beams, see `misses`.
        spacing: `time`, or `distance`: the scans of a log count as evenly spaced, and time is their number.

    Raises:
        InputError: a value is outside of its range.
    """

    center: str | tuple[float, float] = "robot"
    steps: int = 100
    step_s: float = 0.1
    range_max_m: float | None = None
    spacing: str = "time"
    misses: str = "free"

    def __post_init__(self) -> None:
        has_steps = float(self.steps).is_integer() and 1 <= self.steps <= MAX_STEPS
        if not has_steps or not MIN_STEP_S <= self.step_s < math.inf:
            raise InputError(
                f"expected 1 to {MAX_STEPS} steps and a step_s of at least {MIN_STEP_S} s, got {self.steps} and "
                f"{self.step_s}"
            )
        object.__setattr__(self, "steps", int(self.steps))  # also where NumPy has counted them
        object.__setattr__(self, "step_s", float(self.step_s))
        if self.range_max_m is not None and not self.range_max_m > 0:
            raise InputError(f"range_max_m: expected a positive range [m], got {self.range_max_m}")
        if self.spacing not in SPACINGS:
            raise InputError(f"spacing: expected {' or '.join(SPACINGS)}, got {self.spacing}")
        if self.misses not in MISSES:
            raise InputError(f"misses: expected {' or '.join(MISSES)}, got {self.misses}")
        if isinstance(self.center, str) and self.center in ("robot", "start"):
            return
        try:
            point = np.array(self.center, dtype=float)
        except (TypeError, ValueError):
            point = np.array(math.nan)
        if point.shape != (2,) or not np.isfinite(point).all():
            raise InputError(f"center: expected robot, start or x, y [m], got {self.center!r}")
        object.__setattr__(self, "center", tuple(point.tolist()))

    @property
    def duration_s(self) -> float:
        """Return the time from the first to the last step [s]."""
        return (self.steps - 1) * self.step_s

    def divides(self, gap_s: Any) -> Any:
        """Return whether no window has two kept scans, given the time between them [s], or the times."""
        return (gap_s > self.longest_gap_s) | (gap_s <= 0)

    @property
    def longest_gap_s(self) -> float:
        """Return the time between two scans beyond which no window has both [s]."""
        return (2 * MAX_AGE_STEPS + TOLERANCE) * self.step_s

    def origin(self, first: np.ndarray, last: np.ndarray, size_m: float) -> np.ndarray:
        """Return the lower left corner of a map [m], (2,), by the first pose of a log and the last one of a window."""
        centers = {"start": first[:2], "robot": last[:2]}
        return (centers[self.center] if isinstance(self.center, str) else np.array(self.center)) - size_m / 2

    def is_filled(self, first_s: float, end_s: float) -> bool:
        """Return whether the scans from a time on fill a window with this end [s]; its first scan may be half late."""
        return end_s - first_s >= self.duration_s - (0.5 + TOLERANCE) * self.step_s


def window_of(
    predictor: Predictor, steps: int | None = None, step_s: float | None = None, **others: Any
) -> WindowSettings:
    """Return the windows for a network, with the steps of its training where None is given, and other settings.

    Raises:
        InputError: a value is outside of its range, or the network has learned fixed obstacles and the center moves.
    """
    steps, step_s = predictor.steps if steps is None else steps, predictor.step_s if step_s is None else step_s
    settings, least = WindowSettings(steps=steps, step_s=step_s, **others), predictor.encoding.frames
    if settings.steps < least:
        raise InputError(f"steps: expected at least {least}, one for each part of the encoding, got {settings.steps}")
    predictor.check_center(settings.center)
    return settings


class Clock:
    """Chooses scans by their times as they arrive.

    A scan is left out if it is not later than the one before, or follows it by less than half a step. A gap of more
    than ten steps, or a time that is earlier by more than a window, begins a new part. A wrong time costs one scan: if
    that of the last kept scan is not between those of the one before and of the next, the next one takes its place.

    Args:
        settings: steps of the windows.

    Attributes:
        left_out: number of scans that were left out, by reason.
        replaces: whether the last scan takes the place of the one that was kept before.
    """

    def __init__(self, settings: WindowSettings) -> None:
        self.settings = settings
        self.left_out: Counter[str] = Counter()
        self.replaces = False
        self._last_s, self._before_s = -math.inf, math.inf

    def why_left_out(self, stamp: float) -> str | None:
        """Take the time of the next scan [s], and return why it is left out; None if it is kept."""
        least_s, since_s = (0.5 - TOLERANCE) * self.settings.step_s, stamp - self._last_s
        is_wrong = not self._before_s < self._last_s <= stamp  # the last time, or this one
        self.replaces = is_wrong and stamp - self._before_s >= least_s
        is_set_back = since_s < -max(self.settings.duration_s, self.settings.step_s)
        if self.replaces:
            self.left_out[OUT_OF_ORDER] += 1
        elif (since_s < least_s and not is_set_back) or (is_wrong and 0 <= stamp - self._before_s < least_s):
            reason = NOT_LATER if since_s <= 0 else TOO_SOON
            self.left_out[reason] += 1
            return reason
        else:
            self._before_s = self._last_s
        self._last_s = stamp
        return None


def steps_before(stamps: np.ndarray, settings: WindowSettings) -> np.ndarray:
    """Return the index of the scan nearest in time to each step of the window that ends with the last scan, (T,).

    Args:
        stamps: times of the scans of a part without a gap [s], (S,), increasing.
        settings: steps of the window.

    Raises:
        InputError: the window begins before the first scan.
    """
    end, first = float(stamps[-1]), float(stamps[0])
    if not settings.is_filled(first, end):
        raise InputError(f"scans of {end - first:.1f} s before {end:.2f} s, a window takes {settings.duration_s:.1f} s")
    return _nearest(stamps, end - settings.step_s * np.arange(settings.steps - 1, -1, -1))


def ends_of(stamps: np.ndarray, settings: WindowSettings, stride_s: float) -> np.ndarray:
    """Return the indices of the scans that end the windows of a part without a gap, (W,).

    They are the scans nearest to every `stride_s` from the end of the first window on, and each at most once.

    Args:
        stamps: times of the scans of the part [s], (S,), increasing.
        settings: steps of the windows.
        stride_s: the time [s].
    """
    filled = np.flatnonzero([settings.is_filled(stamps[0], stamp) for stamp in stamps])
    if not len(filled):
        return filled
    first_s = stamps[0] + settings.duration_s
    count = int(max(stamps[-1] - first_s, 0) / stride_s + 1e-6) + 1
    if count > 100 * len(filled):  # a stride far below the time between two scans would fill the memory
        return filled
    return np.unique(filled[_nearest(stamps[filled], first_s + stride_s * np.arange(count))])


def parts_of(stamps: np.ndarray, settings: WindowSettings) -> list[tuple[int, int]]:
    """Return begin and end, exclusive, of the parts of kept scans without a gap, given their times [s], (S,)."""
    begins = (np.flatnonzero(settings.divides(np.diff(stamps))) + 1).tolist()
    return list(zip([0, *begins], [*begins, len(stamps)], strict=True))


def _nearest(stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
    if len(stamps) == 1:
        return np.zeros(len(times), dtype=int)
    after = np.searchsorted(stamps, times).clip(1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] <= stamps[after] - times, after - 1, after)
