"""Lidar scans with the robot poses at which they were taken: one type for recordings, encodings and your own data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from repro.system.errors import InputError

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True, eq=False)
class Scans:
    """One window of scans, or a batch of them (B), as NumPy arrays or as tensors.

    Args:
        ranges: lidar ranges [m], (T, N) or (B, T, N), the oldest step first; a miss is inf, an invalid reading is NaN
            (ROS REP 117). The pixels that a miss passes over were observed to be free; a NaN says nothing.
        angles: beam angles in the frame of the poses [rad], (N,), shared by all windows.
        poses: robot poses at each step, x, y [m] and heading [rad], (T, 3) or (B, T, 3).

    Raises:
        ValueError: the shapes disagree, an array is empty, masked or without real numbers, or arrays and tensors are
            mixed.
    """

    ranges: Any
    angles: Any
    poses: Any

    def __post_init__(self) -> None:
        for name in ("ranges", "angles", "poses"):
            _check_array(name, getattr(self, name))
        if len({isinstance(array, np.ndarray) for array in (self.ranges, self.angles, self.poses)}) > 1:
            raise InputError("expected ranges, angles and poses as arrays, or all of them as tensors, got both")
        ranges, angles, poses = (tuple(array.shape) for array in (self.ranges, self.angles, self.poses))
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

    def __len__(self) -> int:
        """Return the number of windows, B."""
        return len(self.ranges) if len(self.ranges.shape) == 3 else 1

    def __getitem__(self, index: int | slice) -> Scans:
        """Return one window (an index) or several windows (a slice) of a batch.

        Raises:
            TypeError: it is one window without an axis of a batch.
        """
        if len(self.ranges.shape) != 3:
            raise TypeError(f"expected a batch of windows, (B, T, N), got one window, {tuple(self.ranges.shape)}")
        return Scans(self.ranges[index], self.angles, self.poses[index])

    @classmethod
    def stack(cls, scans: list[Scans]) -> Scans:
        """Stack windows with the same angles into a batch.

        Raises:
            ValueError: the windows have different angles.
        """
        if any(not np.array_equal(item.angles, scans[0].angles) for item in scans):
            raise InputError("expected windows with the same beam angles, got different ones: predict them separately")
        return cls(np.stack([item.ranges for item in scans]), scans[0].angles, np.stack([item.poses for item in scans]))

    def points(self) -> tuple[Any, Any]:
        """Return where the beams hit, x, y [m], (..., N, 2), and which of them do, bool, (..., N).

        The point of a beam without a hit is that of the lidar.
        """
        library = library_of(self.ranges)
        hit, heading = library.isfinite(self.ranges), self.poses[..., 2:] + self.angles
        directions = library.stack([library.cos(heading), library.sin(heading)], -1)
        return self.poses[..., None, :2] + library.where(hit, self.ranges, 0)[..., None] * directions, hit

    def tensors(self, device: torch.device | str = "cpu", dtype: torch.dtype | None = None) -> Scans:
        """Convert to a batch of tensors on a device, (B, T, N), (N,), (B, T, 3); float32 by default.

        If the angles fall, as those of a lidar that is mounted upside down, the order of the beams is reversed.
        """
        torch = _torch()
        ranges, angles, poses = (
            torch.as_tensor(_contiguous(array), device=device).to(dtype or torch.float32)
            for array in (self.ranges, self.angles, self.poses)
        )
        if angles[0] > angles[-1]:
            ranges, angles = ranges.flip(-1), angles.flip(-1)
        return Scans(ranges, angles, poses) if ranges.dim() == 3 else Scans(ranges[None], angles, poses[None])


def wrapped(angles: Any) -> Any:
    """Return the same angles in [-pi, pi) [rad]."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def library_of(array: Any) -> Any:
    """Return NumPy or torch, whose functions have the same names, for an array or a tensor."""
    return np if isinstance(array, np.ndarray) else _torch()


def _torch() -> Any:
    import torch  # takes a second, and recordings need none

    return torch


def _contiguous(array: Any) -> Any:
    """Return an array with the strides and the byte order that torch takes; a tensor as it is."""
    return np.ascontiguousarray(array, array.dtype.newbyteorder("=")) if isinstance(array, np.ndarray) else array


def _is_real(dtype: Any) -> bool:
    """Return whether a type of NumPy or torch has real numbers."""
    if isinstance(dtype, np.dtype):
        return dtype.kind in "fiu"
    return not dtype.is_complex and str(dtype) != "torch.bool"


def _check_array(name: str, array: Any) -> None:
    if not hasattr(array, "shape") or not hasattr(array, "dtype"):
        raise InputError(f"{name}: expected an array or a tensor, got {type(array).__name__}")
    if isinstance(array, np.ma.MaskedArray):
        raise InputError(f"{name}: expected a plain array, got a masked one: set invalid ranges to NaN, misses to inf")
    if not _is_real(array.dtype):
        raise InputError(f"{name}: expected real numbers, got {array.dtype}")
