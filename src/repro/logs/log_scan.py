"""One scan of a log or of a message, before it is known whether it can be used."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from repro.logs.readings import beams_of_turn
from repro.logs.reasons import Reason


@dataclass(frozen=True)
class LogScan:
    """One scan of a log or of a message.

    Args:
        stamp: time [s].
        ranges: ranges [m], (N,), see `readings`.
        first_angle: angle of the first beam in the frame of the lidar [rad].
        spacing: angle between two beams [rad], negative if they go clockwise.
        range_min_m: smallest valid range [m].
        range_max_m: smallest range that means a miss [m].
        pose: x, y [m] and heading [rad] of the lidar; None where it is unknown.
        problem: why it cannot be used, as its reader knows.
        header: that of the message, where it is needed later.
    """

    stamp: float
    ranges: np.ndarray
    first_angle: float
    spacing: float
    range_min_m: float
    range_max_m: float
    pose: tuple[float, float, float] | None
    problem: Reason | None = None
    header: Any = None

    @property
    def has_valid_range(self) -> bool:
        """Return whether the maximum range is positive and above the minimum, so that misses can be told."""
        return self.range_max_m > max(self.range_min_m, 0)  # false for NaN

    def has_beams_of(self, other: "LogScan") -> bool:
        """Return whether another scan has the same number of beams at the same angles."""
        angles, others = ((scan.first_angle, scan.spacing) for scan in (self, other))
        return len(self.ranges) == len(other.ranges) and np.allclose(angles, others, atol=1e-4)

    def at_beams_of(self, other: "LogScan") -> "LogScan | None":
        """Return the scan at the beams of another one, each with the reading nearest in angle, NaN beyond the ends.

        None, unless both see the same field of view with a similar number of beams.
        """
        if self.has_beams_of(other):
            return self
        if len(self.ranges) < 2 or not 0.5 < self.spacing / other.spacing < 2:
            return None
        first, last = self.first_angle - other.first_angle, len(self.ranges) - 1
        end = first + self.spacing * last - other.spacing * (len(other.ranges) - 1)
        if max(abs(first), abs(end)) > 2 * abs(other.spacing):
            return None
        place = (other.first_angle + other.spacing * np.arange(len(other.ranges)) - self.first_angle) / self.spacing
        index = np.rint(place).astype(int)
        ranges = np.where((index >= 0) & (index <= last), self.ranges[index.clip(0, last)], np.nan).astype(np.float32)
        return replace(self, ranges=ranges, first_angle=other.first_angle, spacing=other.spacing)

    def in_order(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angles [rad], (N,), and the index, (N,), of the beams by increasing angle.

        The last beams of a full turn that point where the first ones do are left out.
        """
        index = np.arange(len(self.ranges))
        angles = self.first_angle + self.spacing * index
        if angles[-1] < angles[0]:
            angles, index = angles[::-1], index[::-1]
        count = beams_of_turn(angles)
        return angles[:count] - (2 * math.pi if angles[count - 1] > 2 * math.pi else 0), index[:count]
