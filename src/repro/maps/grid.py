"""Conversion between meters and pixels; the only place where axes are flipped.

The world axes are those of IR-SIM: x to the right, y up, the origin at the lower left corner of the map. Image axes are
(row, column) with row 0 at the top, so that a displayed image has the orientation of the world in IR-SIM.
"""

import math
from dataclasses import dataclass
from numbers import Integral

import torch
from torch import Tensor

from repro.system.errors import InputError


@dataclass(frozen=True)
class Grid:
    """A square map divided into square pixels.

    Args:
        size_px: pixels along each side, H = W.
        size_m: length of each side [m].

    Raises:
        ValueError: `size_px` is no positive whole number, or `size_m` not positive and finite.
    """

    size_px: int
    size_m: float

    def __post_init__(self) -> None:
        if not isinstance(self.size_px, Integral) or self.size_px < 1 or not 0 < self.size_m < math.inf:
            raise InputError(
                f"a grid needs a whole number of pixels and a positive size, got {self.size_px} px for {self.size_m} m"
            )

    @property
    def resolution_m(self) -> float:
        """Side of one pixel [m]."""
        return self.size_m / self.size_px

    def pixels(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Return the pixel that contains each point.

        Args:
            points: world coordinates [m], (..., 2).

        Returns:
            index: flat pixel index, row-major, (...); 0 for a point outside the map.
            inside: whether the point lies on the map, (...).
        """
        column = torch.floor(points[..., 0] / self.resolution_m)
        row = self.size_px - 1 - torch.floor(points[..., 1] / self.resolution_m)
        inside = (column >= 0) & (column < self.size_px) & (row >= 0) & (row < self.size_px)
        index = torch.where(inside, row * self.size_px + column, 0.0).long()
        return index, inside

    def centers(self) -> Tensor:
        """Return the world coordinates of all pixel centers [m], row-major from the top, (H W, 2)."""
        y = self.row_centers()
        return torch.stack([y.flip(0).repeat(self.size_px), y.repeat_interleave(self.size_px)], dim=-1)

    def row_centers(self, device: torch.device | str = "cpu") -> Tensor:
        """Return the world y of the pixel centers of each row [m], (H,), decreasing from top to bottom."""
        rows = torch.arange(self.size_px, dtype=torch.float32, device=device)
        return (self.size_px - 0.5 - rows) * self.resolution_m

    def first_column(self, x: Tensor) -> Tensor:
        """Return the first column with its pixel center at or to the right of `x` [m], clipped to [0, W]."""
        return torch.ceil(x / self.resolution_m - 0.5).clamp(0, self.size_px).long()
