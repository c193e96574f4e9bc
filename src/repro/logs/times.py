"""The times of scans and the steps of windows: one set of rules for logs, streams and nodes.

A `Clock` chooses scans by their times, as they arrive, `WindowSettings.divides` finds the parts of the kept scans, and
`steps_before` takes the scan nearest to each step of a window. Logs, streams and nodes use them, so that they predict
the same maps.
"""

import math
from collections import Counter

import numpy as np

from repro.logs.options import TOLERANCE, WindowSettings
from repro.logs.reasons import Reason
from repro.system.errors import InputError


class UnusableTimes(InputError):
    """Times of scans that are lost, or too rare for the steps of windows; the scans may be spaced by distance."""


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
        self.left_out: Counter[Reason] = Counter()
        self.replaces = False
        self._last_s, self._before_s = -math.inf, math.inf

    def why_left_out(self, stamp: float) -> Reason | None:
        """Take the time of the next scan [s], and return why it is left out; None if it is kept."""
        least_s, since_s = (0.5 - TOLERANCE) * self.settings.step_s, stamp - self._last_s
        is_wrong = not self._before_s < self._last_s <= stamp  # the last time, or this one
        self.replaces = is_wrong and stamp - self._before_s >= least_s
        is_set_back = since_s < -max(self.settings.duration_s, self.settings.step_s)
        if self.replaces:
            self.left_out[Reason.OUT_OF_ORDER] += 1
        elif (since_s < least_s and not is_set_back) or (is_wrong and 0 <= stamp - self._before_s < least_s):
            reason = Reason.NOT_LATER if since_s <= 0 else Reason.TOO_SOON
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

    Raises:
        InputError: the window begins before the first scan.
    """
    end, first = float(stamps[-1]), float(stamps[0])
    if not settings.is_filled(first, end):
        raise InputError(f"scans of {end - first:.1f} s before {end:.2f} s, a window takes {settings.duration_s:.1f} s")
    return nearest_of(stamps, end - settings.step_s * np.arange(settings.steps - 1, -1, -1))


def ends_of(stamps: np.ndarray, settings: WindowSettings, stride_s: float) -> np.ndarray:
    """Return the indices of the scans that end the windows of a part without a gap, (W,).

    They are the scans nearest to every `stride_s` from the end of the first window on, and each at most once.

    Args:
        stamps: times of the scans of the part [s], (S,), increasing.
        stride_s: the time [s].
    """
    filled = np.flatnonzero([settings.is_filled(stamps[0], stamp) for stamp in stamps])
    if not len(filled):
        return filled
    first_s = stamps[0] + settings.duration_s
    count = int(max(stamps[-1] - first_s, 0) / stride_s + 1e-6) + 1
    if count > 100 * len(filled):  # a stride far below the time between two scans would fill the memory
        return filled
    return np.unique(filled[nearest_of(stamps[filled], first_s + stride_s * np.arange(count))])


def parts_of(stamps: np.ndarray, settings: WindowSettings) -> list[tuple[int, int]]:
    """Return begin and end, exclusive, of the parts of kept scans without a gap, given their times [s], (S,)."""
    begins = (np.flatnonzero(settings.divides(np.diff(stamps))) + 1).tolist()
    return list(zip([0, *begins], [*begins, len(stamps)], strict=True))


def between_scans_s(stamps: np.ndarray) -> float:
    """Return the median time from scan to scan [s], given their times [s], (S,); 0 if all are at one time."""
    gaps = np.diff(stamps)
    return float(np.median(gaps[gaps > 0])) if (gaps > 0).any() else 0.0


def nearest_of(stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the index of the increasing value (S,) that is nearest to each of others, the earlier of two."""
    if len(stamps) == 1:
        return np.zeros(len(times), dtype=int)
    after = np.searchsorted(stamps, times).clip(1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] <= stamps[after] - times, after - 1, after)
