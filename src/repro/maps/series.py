"""Encodings with a series of images: one image per part of the window instead of one image of the whole window."""

from typing import ClassVar

import torch
from pydantic.dataclasses import dataclass
from torch import Tensor

from repro.config import Frames, Positive
from repro.maps.grid import Grid
from repro.maps.projection import CHECKED, newest_hits
from repro.maps.visibility import newest_visible
from repro.scans import Scans


@dataclass(frozen=True, config=CHECKED)
class Stack:
    """A series of images: the hits of each part of the window in a separate image, oldest part first, all black.

    The paper argues against this multi-image input without testing it ("Cumulative Dynamic Sensor Projection").

    Args:
        frames: number of images and of parts of the window.

    Raises:
        ValueError: `frames` is not an integer from 1 to 100.
    """

    kind: ClassVar[str] = "stack"

    frames: Frames

    @property
    def name(self) -> str:
        return f"{self.kind}{self.frames}"

    @property
    def channels(self) -> int:
        return self.frames

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        return _black(torch.stack([newest_hits(part, grid) > 0 for part in self._parts(scans)], dim=1))

    def to_input(self, images: Tensor) -> Tensor:
        return 1 - images.float() / 255  # networks learn slowly from many images of mostly ones

    def _parts(self, scans: Scans) -> list[Scans]:
        steps = torch.arange(scans.ranges.shape[1], device=scans.ranges.device).tensor_split(self.frames)
        return [Scans(scans.ranges[:, part], scans.angles, scans.poses[:, part]) for part in steps]


@dataclass(frozen=True, config=CHECKED)
class Series(Stack):
    """Two series of images: the hits of each part of the window, then the pixels observed to be free in each part.

    A pixel is observed to be free in a part if a beam passes over it at any step of the part. DeepTracking (Ondruska
    and Posner, AAAI 2016) receives the same two images at every step.

    Args:
        frames: number of parts of the window; twice as many images.
        range_max_m: maximum range of the lidar [m].

    Raises:
        ValueError: `frames` is not an integer from 1 to 100, or `range_max_m` is not positive.
    """

    kind: ClassVar[str] = "series"

    range_max_m: Positive = 30.0

    @property
    def channels(self) -> int:
        return 2 * self.frames

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        margin_m = -grid.resolution_m / 2
        free = [newest_visible(part, grid, self.range_max_m, margin_m=margin_m) > 0 for part in self._parts(scans)]
        return torch.cat([super().encode(scans, grid), _black(torch.stack(free, dim=1))], dim=1)


def _black(drawn: Tensor) -> Tensor:
    """Convert a mask to a gray image, black (0) where it is true, uint8."""
    return 255 * (~drawn).to(torch.uint8)
