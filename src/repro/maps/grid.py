"""Conversion between meters and pixels; the only place where axes are flipped.

The world axes are those of IR-SIM: x to the right, y up, the origin at the lower left corner of the map. Image axes are
(row, column) with row 0 at the top, so that a displayed image has the orientation of the world in IR-SIM.
"""

from dataclasses import dataclass
from numbers import Integral

import numpy as np

from repro.system.errors import InputError

LARGEST_PX, LARGEST_M = 4096, 10_000.0  # side of a map


@dataclass(frozen=True)
class Grid:
    """A square map divided into square pixels.

    Args:
        size_px: pixels along each side, H = W.
        size_m: length of each side [m].

    Raises:
        InputError: `size_px` is no positive whole number, or `size_m` not positive and finite.
    """

    size_px: int
    size_m: float

    def __post_init__(self) -> None:
        if (
            not isinstance(self.size_px, Integral)
            or not 1 <= self.size_px <= LARGEST_PX
            or isinstance(self.size_m, bool)
            or not 0 < self.size_m <= LARGEST_M
        ):
            raise InputError(
                f"a grid needs a whole number of pixels and a positive size, got {self.size_px} px for {self.size_m} m"
            )

    @property
    def resolution_m(self) -> float:
        """Side of one pixel [m]."""
        return self.size_m / self.size_px

    def centers(self) -> np.ndarray:
        """Return the world coordinates of all pixel centers [m], row-major from the top, (H W, 2)."""
        y = self.row_centers()
        return np.stack([np.tile(y[::-1], self.size_px), np.repeat(y, self.size_px)], axis=-1)

    def row_centers(self) -> np.ndarray:
        """Return the world y of the pixel centers of each row [m], (H,), decreasing from top to bottom."""
        return (self.size_px - np.float32(0.5) - np.arange(self.size_px, dtype=np.float32)) * self.resolution_m

    def first_column(self, x: np.ndarray) -> np.ndarray:
        """Return the first column with its pixel center at or to the right of `x` [m], clipped to [0, W]."""
        return np.ceil(x / self.resolution_m - 0.5).clip(0, self.size_px).astype(np.int64)
