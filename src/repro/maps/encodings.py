"""Encodings: how a window of scans becomes the network's input. Chosen by conf/encoding, made by `create_encoding`.

An encoding is a frozen dataclass of its parameters. It draws uint8 images, many windows at once, at any resolution,
on the CPU or a GPU; it says what a network is to be fed with. The paper's own is `projection.Projection`; a new one is
a class here, a line in `ENCODINGS` and a file in conf/encoding.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.maps.projection import Projection, newest_hits
from repro.maps.visibility import newest_visible
from repro.scans import Scans


class Encoding(Protocol):
    """What every encoding has."""

    @property
    def name(self) -> str:
        """What conf/encoding calls it."""

    @property
    def channels(self) -> int:
        """Channels of its images, C."""

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        """Draws the images of a batch of scans, uint8, (B, C, H, W)."""

    def to_input(self, images: Tensor) -> Tensor:
        """Turns images into what a network takes, float32 in [0, 1], of the same shape."""


@dataclass(frozen=True)
class Negative(Projection):
    """The projection fed as its negative, hits bright on a background of zeros: the same image, other numbers."""

    name: ClassVar[str] = "negative"

    def to_input(self, images: Tensor) -> Tensor:
        return 1 - images.float() / 255


@dataclass(frozen=True)
class Exponential(Projection):
    """The projection with a gray that fades by halves: after `half_life` steps half way from black to `oldest_gray`.

    Args:
        half_life: steps.

    Raises:
        ValueError: `half_life` is not positive, or see `Projection`.
    """

    name: ClassVar[str] = "exponential"

    half_life: float = 15.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.half_life <= 0:
            raise ValueError(f"half_life must be positive, got {self.half_life}")

    def _law(self, steps: int) -> Tensor:
        return self.oldest_gray * (1 - 0.5 ** (torch.arange(steps - 1, -1, -1) / self.half_life))


@dataclass(frozen=True)
class Ages(Negative):
    """The projection's ages apart from its hits: where a beam ever ended (black), and how long ago (gray).

    The projection says both by one gray, so that an old hit is nearly the white of no hit. Here the second image has
    the gray of the projection, and the first is the projection without decay; both are fed as their negatives.
    """

    name: ClassVar[str] = "ages"
    channels: ClassVar[int] = 2

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        faded = super().encode(scans, grid)
        return torch.cat([torch.where(faded < 255, 0, 255).to(torch.uint8), faded], dim=1)


@dataclass(frozen=True)
class ObservedFree(Negative):
    """The projection, and a second image of when each pixel was last seen to be free.

    A beam that passed over a pixel says that it was free then, which the projection throws away. The second image has
    the gray of the last step at which that happened, by the projection's own law, white where it never did. Both are
    fed as their negatives.

    Args:
        range_max_m: how far a beam reaches that hits nothing [m].

    Raises:
        ValueError: `range_max_m` is not positive, or see `Projection`.
    """

    name: ClassVar[str] = "observed_free"
    channels: ClassVar[int] = 2

    range_max_m: float = 30.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.range_max_m <= 0:
            raise ValueError(f"range_max_m must be positive, got {self.range_max_m}")

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        passed = newest_visible(scans, grid, self.range_max_m, margin_m=-grid.resolution_m / 2)
        return torch.cat([super().encode(scans, grid), self._shade(passed.int(), scans.ranges.shape[1])], dim=1)


@dataclass(frozen=True)
class Stack:
    """Several images in a row: the hits of each part of the window by themselves, oldest part first, equally black.

    The multi-image input that the paper argues against ("Cumulative Dynamic Sensor Projection") and did not try.

    Args:
        frames: images, the parts into which the window is cut.

    Raises:
        ValueError: `frames` is below 1.
    """

    frames: int

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise ValueError(f"frames must be at least 1, got {self.frames}")

    @property
    def name(self) -> str:
        return f"stack{self.frames}"

    @property
    def channels(self) -> int:
        return self.frames

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        parts = torch.arange(scans.ranges.shape[1], device=scans.ranges.device).tensor_split(self.frames)
        drawn = [newest_hits(Scans(scans.ranges[:, p], scans.angles, scans.poses[:, p]), grid) == 0 for p in parts]
        return 255 * torch.stack(drawn, dim=1).to(torch.uint8)

    def to_input(self, images: Tensor) -> Tensor:
        return 1 - images.float() / 255  # of many images of nearly nothing but ones a network is slow to learn


ENCODINGS: dict[str, type[Encoding]] = {
    "projection": Projection,
    "negative": Negative,
    "exponential": Exponential,
    "ages": Ages,
    "observed_free": ObservedFree,
    "stack4": Stack,
    "stack10": Stack,
}


def create_encoding(name: str, parameters: dict[str, Any]) -> Encoding:
    """Creates an encoding from its name and parameters.

    Raises:
        ValueError: the name is unknown, a parameter is, or a value is not allowed.
    """
    if name not in ENCODINGS:
        raise ValueError(f"encoding must be one of {', '.join(ENCODINGS)}, got {name!r}")
    known = [field.name for field in dataclasses.fields(ENCODINGS[name])]  # type: ignore[arg-type]
    unknown = sorted(set(parameters) - set(known))
    if unknown:
        raise ValueError(f"encoding {name} takes {', '.join(known)}, got {', '.join(unknown)}")
    encoding = ENCODINGS[name](**parameters)
    if encoding.name != name:
        raise ValueError(f"encoding {name} is not what its parameters {parameters} make, which is {encoding.name}")
    return encoding
