"""Encodings: from a window of scans to the input of a network.

An encoding is a frozen dataclass of its parameters, selected by conf/encoding and created by `create_encoding`. It
draws the uint8 images of a batch of windows at any resolution, on the CPU or a GPU, and converts them to the input of a
network. The paper's encoding is `projection.Projection`. A new encoding needs a class here, a line in `ENCODINGS` and a
file in conf/encoding.
"""

import dataclasses
from typing import Any, ClassVar, Protocol

import torch
from pydantic import ValidationError
from pydantic.dataclasses import dataclass
from torch import Tensor

from repro.fields import STRICT, Positive, config_errors_of
from repro.maps.grid import Grid
from repro.maps.projection import Projection, inverted
from repro.maps.series import Series, Stack
from repro.maps.visibility import newest_passed
from repro.scans import Scans
from repro.system.errors import InputError


class Encoding(Protocol):
    """The interface of an encoding."""

    @property
    def name(self) -> str:
        """Name of the encoding in conf/encoding."""

    @property
    def channels(self) -> int:
        """Number of channels of the images, C."""

    @property
    def frames(self) -> int:
        """Number of parts of the window that have images of their own; C is a multiple of it."""

    @property
    def is_binary(self) -> bool:
        """Whether the images have no other values than 0 and 255, so that a bit per pixel is stored."""

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        """Draw the images of a batch of scans, uint8, (B, C, H, W)."""

    def to_input(self, images: Tensor) -> Tensor:
        """Convert images to the input of a network, float32 in [0, 1], of the same shape."""


@dataclass(frozen=True, config=STRICT)
class Negative(Projection):
    """The projection with inverted intensities as the input: hits are bright and the background is zero."""

    name: ClassVar[str] = "negative"

    def to_input(self, images: Tensor) -> Tensor:
        return inverted(images)


@dataclass(frozen=True, config=STRICT)
class Exponential(Projection):
    """The projection with an exponential decay: a hit of age `half_life` is halfway from black to `oldest_gray`.

    Args:
        half_life: age at which half of the decay is reached [steps].

    Raises:
        ValueError: a parameter has another type, `half_life` is not positive, or `oldest_gray` is not in [0, 254/255].
    """

    name: ClassVar[str] = "exponential"

    half_life: Positive = 15.0

    def _law(self, steps: int) -> Tensor:
        return self.oldest_gray * (1 - 0.5 ** (torch.arange(steps - 1, -1, -1) / self.half_life))


@dataclass(frozen=True, config=STRICT)
class Ages(Negative):
    """The position of the hits and their age as separate images.

    The projection encodes both in one gray value, so an old hit is almost as white as the background. Here the first
    image is the projection without decay and the second is the projection. Both are input with inverted intensities.
    """

    name: ClassVar[str] = "ages"
    channels: ClassVar[int] = 2

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        faded = super().encode(scans, grid)
        return torch.cat([torch.where(faded < 255, 0, 255).to(torch.uint8), faded], dim=1)


@dataclass(frozen=True, config=STRICT)
class ObservedFree(Negative):
    """The projection, and a second image of when each pixel was last observed to be free.

    A beam that passes over a pixel shows that it is free at that step, which the projection discards. The second image
    has the gray of the last such step, by the decay law of the projection, and is white without one. Both are input
    with inverted intensities.

    Args:
        range_max_m: maximum range of the lidar [m].

    Raises:
        ValueError: a parameter has another type, `range_max_m` is not positive, or `oldest_gray` not in [0, 254/255].
    """

    name: ClassVar[str] = "observed_free"
    channels: ClassVar[int] = 2

    range_max_m: Positive = 30.0

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        passed = newest_passed(scans, grid, self.range_max_m)
        return torch.cat([super().encode(scans, grid), self._shade(passed.int(), scans.ranges.shape[1])], dim=1)


ENCODINGS: dict[str, type[Encoding]] = {
    "projection": Projection,
    "negative": Negative,
    "exponential": Exponential,
    "ages": Ages,
    "observed_free": ObservedFree,
    "stack4": Stack,
    "stack10": Stack,
    "series4": Series,
    "series10": Series,
    "series100": Series,
}


def create_encoding(name: str, parameters: dict[str, Any]) -> Encoding:
    """Create an encoding from its name and parameters.

    Raises:
        ValueError: the name or a parameter is unknown, or a value is not allowed.
    """
    if name not in ENCODINGS:
        raise InputError(f"encoding must be one of {', '.join(ENCODINGS)}, got {name!r}")
    known = [field.name for field in dataclasses.fields(ENCODINGS[name])]  # type: ignore[arg-type]
    unknown = sorted(set(parameters) - set(known))
    if unknown:
        raise InputError(f"encoding {name} takes {', '.join(known)}, got {', '.join(unknown)}")
    try:
        encoding = ENCODINGS[name](**parameters)
    except ValidationError as error:
        raise InputError("; ".join(str(each) for each in config_errors_of(error))) from error
    if encoding.name != name:
        raise InputError(f"encoding {name} does not match its parameters {parameters}, which describe {encoding.name}")
    return encoding
