"""Scans: what a lidar on a known path has measured, the one type for recordings, encodings and data of your own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Scans:
    """One window of scans, or a batch of them (B), as NumPy arrays or as tensors.

    Args:
        ranges: lidar ranges [m], (T, N) or (B, T, N); a miss is inf.
        angles: beam angles in the robot's frame [rad], (N,), the same for all.
        poses: robot poses at each step, x, y [m] and heading [rad], (T, 3) or (B, T, 3).

    Raises:
        ValueError: the shapes disagree.
    """

    ranges: Any
    angles: Any
    poses: Any

    def __post_init__(self) -> None:
        ranges, angles, poses = (tuple(array.shape) for array in (self.ranges, self.angles, self.poses))
        agree = len(ranges) in (2, 3) and len(angles) == 1 and ranges[-1:] == angles and poses == (*ranges[:-1], 3)
        if not agree:
            raise ValueError(
                "expected ranges (B, T, N), angles (N,), poses (B, T, 3), or ranges and poses without B, got "
                f"{ranges}, {angles}, {poses}"
            )

    def __len__(self) -> int:
        """Number of windows, B."""
        return len(self.ranges) if len(self.ranges.shape) == 3 else 1

    def __getitem__(self, index: int | slice) -> Scans:
        """Takes one window (an index) or some (a slice) of a batch."""
        return Scans(self.ranges[index], self.angles, self.poses[index])

    @classmethod
    def stack(cls, scans: list[Scans]) -> Scans:
        """Makes a batch of windows with the same angles."""
        return cls(np.stack([item.ranges for item in scans]), scans[0].angles, np.stack([item.poses for item in scans]))

    def tensors(self, device: torch.device | str = "cpu", dtype: torch.dtype | None = None) -> Scans:
        """Gives a batch of tensors on a device, (B, T, N), (N,), (B, T, 3); float32 unless told otherwise."""
        import torch

        ranges, angles, poses = (
            torch.as_tensor(array, device=device).to(dtype or torch.float32)
            for array in (self.ranges, self.angles, self.poses)
        )
        return Scans(ranges, angles, poses) if ranges.dim() == 3 else Scans(ranges[None], angles, poses[None])
