"""Lidar scans with the robot poses at which they were taken: one type for recordings, encodings and your own data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from repro.system.arrays import real
from repro.system.errors import InputError


@dataclass(frozen=True, eq=False, repr=False)
class Scans:
    """One window of scans, or a batch of them (B).

    Args:
        ranges: lidar ranges [m], (T, N) or (B, T, N), the oldest step first; a miss is inf, an invalid reading is NaN
            (ROS REP 117). The pixels that a miss passes over were observed to be free; a NaN says nothing.
        angles: beam angles in the frame of the poses [rad], (N,), shared by all windows.
        poses: robot poses at each step, x, y [m] and heading [rad], (T, 3) or (B, T, 3).

    Raises:
        InputError: the shapes disagree, or an array is empty, masked or without real numbers.
    """

    ranges: np.ndarray
    angles: np.ndarray
    poses: np.ndarray

    def __post_init__(self) -> None:
        for name in ("ranges", "angles", "poses"):
            kinds = "f" if name == "ranges" else "fiu"  # whole numbers are rounded ranges, or those of another unit
            object.__setattr__(self, name, real(name, getattr(self, name), kinds=kinds))
        ranges, angles, poses = self.ranges.shape, self.angles.shape, self.poses.shape
        agree = (
            len(ranges) in (2, 3)
            and min(ranges) > 0
            and len(angles) == 1
            and ranges[-1:] == angles
            and poses == (*ranges[:-1], 3)
        )
        if not agree:
            raise InputError(
                "expected ranges (B, T, N), angles (N,), poses (B, T, 3), none of them empty, "
                "or ranges and poses without B, got "
                f"{ranges}, {angles}, {poses}"
            )

    def __repr__(self) -> str:
        *windows, steps, beams = self.ranges.shape
        return f"Scans({f'{windows[0]} windows of ' if windows else ''}{steps} steps, {beams} beams)"

    def __len__(self) -> int:
        """Return the number of windows, B."""
        return len(self.ranges) if self.ranges.ndim == 3 else 1

    def __getitem__(self, index: int | slice) -> Scans:
        """Return one window (an index) or several windows (a slice) of a batch.

        Raises:
            TypeError: it is one window without an axis of a batch.
        """
        if self.ranges.ndim != 3:
            raise TypeError(f"expected a batch of windows, (B, T, N), got one window, {self.ranges.shape}")
        return Scans(self.ranges[index], self.angles, self.poses[index])

    @classmethod
    def stack(cls, scans: list[Scans]) -> Scans:
        """Stack windows with the same angles into a batch.

        Raises:
            InputError: the windows have different angles.
        """
        if any(not np.array_equal(item.angles, scans[0].angles) for item in scans):
            raise InputError("expected windows with the same beam angles, got different ones: predict them separately")
        return cls(np.stack([item.ranges for item in scans]), scans[0].angles, np.stack([item.poses for item in scans]))

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return where the beams hit, x, y [m], (..., N, 2), and which of them do, bool, (..., N).

        The point of a beam without a hit is that of the lidar.
        """
        hit, heading = np.isfinite(self.ranges), self.poses[..., 2:] + self.angles
        directions = np.stack([np.cos(heading), np.sin(heading)], -1)
        return self.poses[..., None, :2] + np.where(hit, self.ranges, 0)[..., None] * directions, hit

    def batched(self, dtype: type[np.floating] = np.float32) -> Scans:
        """Return a batch of one type, (B, T, N), (N,), (B, T, 3), as the functions of `maps` take it.

        If the angles fall, as those of a lidar that is mounted upside down, the order of the beams is reversed.
        """
        ranges, angles, poses = (np.asarray(array, dtype) for array in (self.ranges, self.angles, self.poses))
        if angles[0] > angles[-1]:
            ranges, angles = ranges[..., ::-1], angles[::-1]
        ranges, angles, poses = map(np.ascontiguousarray, (ranges, angles, poses))
        return Scans(ranges, angles, poses) if ranges.ndim == 3 else Scans(ranges[None], angles, poses[None])


def wrapped(angles: Any) -> Any:
    """Return the same angles in [-pi, pi) [rad]."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def repeats(rows: np.ndarray) -> np.ndarray:
    """Return whether each row of (T, N) but the first equals the one before, where NaN equals NaN, bool, (T - 1,)."""
    before, after = rows[:-1], rows[1:]
    return ((before == after) | (np.isnan(before) & np.isnan(after))).all(1)
