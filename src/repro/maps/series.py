"""Encodings with a series of images: one image per part of the window instead of one image of the whole window."""

import dataclasses
from bisect import bisect_left
from typing import ClassVar

import numpy as np
import torch
from pydantic.dataclasses import dataclass
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from repro.fields import STRICT, FrameCount, MaximumRange
from repro.maps.grid import Grid
from repro.maps.projection import hit_pixels, inverted
from repro.maps.visibility import newest_passed
from repro.scans import Scans
from repro.system.errors import InputError

PRECISION = 1_000_000  # of the factor between the lengths of two parts
ROUNDING = 1e-3  # steps


@dataclass(frozen=True, config=STRICT)
class Stack:
    """A series of images: the hits of each part of the window in a separate image, oldest part first, all black.

    The paper argues against this multi-image input without testing it ("Cumulative Dynamic Sensor Projection").

    Args:
        frames: number of images and of parts of the window.

    Raises:
        ValueError: `frames` is not an integer from 1 to 100.
    """

    kind: ClassVar[str] = "stack"
    is_binary: ClassVar[bool] = True

    frames: FrameCount

    @property
    def name(self) -> str:
        return f"{self.kind}{self.frames}"

    @property
    def channels(self) -> int:
        return self.frames

    @property
    def reach_m(self) -> float:
        return 0.0

    def with_range(self, range_max_m: float) -> "Stack":
        return self

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        return _draw_hits(self._parts(scans), grid).unflatten(0, (-1, self.frames))

    def to_input(self, images: Tensor) -> Tensor:
        return inverted(images)  # networks learn slowly from many images of mostly ones

    def _ends(self, count: int) -> list[int]:
        """Return the step after each part of a window of so many steps, oldest part first."""
        return np.cumsum([len(part) for part in np.array_split(np.arange(count), self.frames)]).tolist()

    def _parts(self, scans: Scans) -> Scans:
        """Return the K parts of B windows as B K windows; shorter parts end with steps without hit and pose."""
        count = scans.ranges.shape[1]
        if count < self.frames:
            raise InputError(f"{self.name} divides a window into {self.frames} parts, got a window of {count} steps")
        steps = torch.arange(count, device=scans.ranges.device)
        parts = pad_sequence(list(steps.tensor_split(self._ends(count)[:-1])), batch_first=True, padding_value=-1)
        absent = (parts < 0)[..., None]
        ranges = scans.ranges[:, parts].masked_fill(absent, torch.inf)
        poses = scans.poses[:, parts].masked_fill(absent, torch.nan)
        return Scans(ranges.flatten(0, 1), scans.angles, poses.flatten(0, 1))


@dataclass(frozen=True, config=STRICT)
class Series(Stack):
    """Two series of images: the hits of each part of the window, then the pixels observed to be free in each part.

    A pixel is observed to be free in a part if a beam passes over it at any step of the part. The two images are those
    of Ondruska and Posner (AAAI 2016).

    Args:
        frames: number of parts of the window; twice as many images.
        range_max_m: maximum range of the lidar [m].

    Raises:
        ValueError: `frames` is not an integer from 1 to 100, or `range_max_m` not from 0 to 10,000.
    """

    kind: ClassVar[str] = "series"

    range_max_m: MaximumRange = 30.0

    @property
    def channels(self) -> int:
        return 2 * self.frames

    @property
    def reach_m(self) -> float:
        return self.range_max_m

    def with_range(self, range_max_m: float) -> "Series":
        return dataclasses.replace(self, range_max_m=range_max_m)

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        parts = self._parts(scans)
        passed = newest_passed(parts, grid, self.range_max_m)
        images = torch.stack([_draw_hits(parts, grid), _gray(passed > 0)])  # (2, B K, H, W)
        return images.unflatten(1, (-1, self.frames)).transpose(0, 1).flatten(1, 2)


@dataclass(frozen=True, config=STRICT)
class Recent(Series):
    """A series whose parts get shorter towards now: the newest is a single step, each older one longer by one factor.

    In equal parts of a second, whoever walks is a smear of several pixels, and the newest scan looks like one of a
    second ago. The factor is such that the parts fill the window; their ends are rounded up.

    Args:
        frames: number of parts of the window; twice as many images.
        range_max_m: maximum range of the lidar [m].

    Raises:
        InputError: `frames` is not an integer from 1 to 100, or `range_max_m` not from 0 to 10,000.
    """

    kind: ClassVar[str] = "recent"

    def _ends(self, count: int) -> list[int]:
        powers = np.arange(self.frames)
        tried = range(PRECISION, count * PRECISION)
        factor = bisect_left(tried, count, key=lambda number: ((number / PRECISION) ** powers).sum()) + PRECISION
        ages = np.ceil(np.cumsum((factor / PRECISION) ** powers)[:-1] - ROUNDING).astype(int)
        return [*(count - ages[::-1]).tolist(), count]


def _draw_hits(scans: Scans, grid: Grid) -> Tensor:
    """Draw the hits of each window, black on white, uint8, (B, H, W)."""
    pixels, hit = hit_pixels(scans, grid)
    images = torch.full((len(scans), grid.size_px**2), 255, dtype=torch.uint8, device=hit.device)
    images.scatter_reduce_(1, pixels.flatten(1), _gray(hit).flatten(1), reduce="amin")
    return images.view(-1, grid.size_px, grid.size_px)


def _gray(seen: Tensor) -> Tensor:
    """Return black where something is seen and white elsewhere, uint8, of the same shape."""
    return (~seen).to(torch.uint8).mul_(255)
