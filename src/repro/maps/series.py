"""Encodings with a series of images: one image per part of the window instead of one image of the whole window."""

import dataclasses
from bisect import bisect_left
from typing import ClassVar

import numpy as np
from pydantic.dataclasses import dataclass

from repro.maps.grid import Grid
from repro.maps.projection import count_hits, newest_hits
from repro.maps.visibility import count_passed, newest_passed
from repro.scans import Scans
from repro.system.errors import InputError
from repro.system.fields import STRICT, FrameCount, MaximumRange

PRECISION = 1_000_000  # of the factor between the lengths of two parts
ROUNDING = 1e-3  # steps


@dataclass(frozen=True, config=STRICT)
class Stack:
    """A series of images: the hits of each part of the window in a separate image, oldest part first, all black.

    The paper argues against this multi-image input without testing it ("Cumulative Dynamic Sensor Projection").

    Args:
        frames: number of images and of parts of the window, from 1 to 100.
    """

    kind: ClassVar[str] = "stack"
    bits: ClassVar[int] = 1
    is_inverted: ClassVar[bool] = True  # networks learn slowly from many images of mostly ones

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

    def encode(self, scans: Scans, grid: Grid) -> np.ndarray:
        return self._by_window(newest_hits(self._parts(scans), grid) > 0)

    def _by_window(self, seen: np.ndarray) -> np.ndarray:
        """Return what is seen in B K parts as images of B windows: black, white elsewhere, uint8, (B, K, H, W)."""
        return (~seen).astype(np.uint8).reshape(-1, self.frames, *seen.shape[1:]) * np.uint8(255)

    def _ends(self, count: int) -> list[int]:
        """Return the step after each part of a window of so many steps, oldest part first."""
        return np.cumsum([len(part) for part in np.array_split(np.arange(count), self.frames)]).tolist()

    def _parts(self, scans: Scans) -> Scans:
        """Return the K parts of B windows as B K windows; shorter parts end with steps without hit and pose."""
        count = scans.ranges.shape[1]
        if count < self.frames:
            raise InputError(f"{self.name} divides a window into {self.frames} parts, got a window of {count} steps")
        ends = self._ends(count)
        lengths = np.diff(ends, prepend=0)
        parts = (ends - lengths)[:, None] + np.arange(lengths.max())  # (K, steps)
        absent = parts >= np.array(ends)[:, None]
        parts = parts.clip(max=count - 1)
        ranges, poses = scans.ranges[:, parts], scans.poses[:, parts]  # (B, K, steps, ...), copies
        ranges[:, absent], poses[:, absent] = np.inf, np.nan
        return Scans(ranges.reshape(-1, *ranges.shape[2:]), scans.angles, poses.reshape(-1, *poses.shape[2:]))


@dataclass(frozen=True, config=STRICT)
class Series(Stack):
    """Two series of images: the hits of each part of the window, then the pixels observed to be free in each part.

    A pixel is observed to be free in a part if a beam passes over it at any step of the part. The two images are those
    of Ondruska and Posner (AAAI 2016).

    Args:
        frames: number of parts of the window; twice as many images.
        range_max_m: maximum range of the lidar [m].
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

    def encode(self, scans: Scans, grid: Grid) -> np.ndarray:
        parts = self._parts(scans)
        seen = newest_hits(parts, grid), newest_passed(parts, grid, self.range_max_m)
        return np.concatenate([self._by_window(newest > 0) for newest in seen], axis=1)


@dataclass(frozen=True, config=STRICT)
class Recent(Series):
    """A series whose parts get shorter towards now: the newest is a single step, each older one longer by one factor.

    In equal parts of a second, whoever walks is a smear of several pixels, and the newest scan looks like one of a
    second ago. The factor is such that the parts fill the window; their ends are rounded up, and no part is longer than
    an older one.
    """

    kind: ClassVar[str] = "recent"

    def _ends(self, count: int) -> list[int]:
        powers = np.arange(self.frames)
        tried = range(PRECISION, count * PRECISION)
        with np.errstate(over="ignore"):  # of factors that are much too large
            factor = bisect_left(tried, count, key=lambda number: ((number / PRECISION) ** powers).sum()) + PRECISION
        ages = np.ceil(np.cumsum((factor / PRECISION) ** powers)[:-1] - ROUNDING).astype(int)
        return np.cumsum(np.sort(np.diff([0, *ages, count]))[::-1]).tolist()


@dataclass(frozen=True, config=STRICT)
class Counts(Recent):
    """The same series with counts: how many scans of each part hit, or passed over, each pixel.

    The darkness of a pixel is the logarithm of one plus its count, over that of one plus the steps of the part, in 16
    grays: where each scan of a part hit it, it is as black as in `Recent`. The difference of the logarithms of hits and
    passes is about the log odds of an occupancy grid.
    """

    kind: ClassVar[str] = "counts"
    bits: ClassVar[int] = 4

    def encode(self, scans: Scans, grid: Grid) -> np.ndarray:
        parts, lengths = self._parts(scans), np.diff(self._ends(scans.ranges.shape[1]), prepend=0)
        shares = np.log1p(np.arange(lengths.max() + 1)) / np.log1p(lengths[:, None])
        grays = 17 * (15 - np.ceil(15 * shares.clip(max=1)).astype(np.uint8))  # of a part and a number of steps
        part = np.arange(self.frames)[:, None, None]
        counts = count_hits(parts, grid), count_passed(parts, grid, self.range_max_m)
        return np.concatenate([grays[part, seen.reshape(-1, self.frames, *seen.shape[1:])] for seen in counts], axis=1)
