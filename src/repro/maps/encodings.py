"""Encodings: from a window of scans to the input of a network.

An encoding is a frozen dataclass of its parameters, selected by conf/encoding and created by `create_encoding`. It
draws the uint8 images of a batch of windows at any resolution; `to_input` converts them to the input of a network. The
paper's encoding is `projection.Projection`. A new encoding needs a class here, a line in `ENCODINGS` and a
file in conf/encoding.
"""

from inspect import signature
from typing import Any, Protocol

import numpy as np
from pydantic import ValidationError

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.maps.series import Counts, Recent, Series, Stack
from repro.scans import Scans
from repro.system.errors import InputError
from repro.system.fields import config_errors_of


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
    def bits(self) -> int:
        """How many bits a pixel is stored in, 1, 4 or 8: its gray is a multiple of 255, 17 or 1."""

    @property
    def is_inverted(self) -> bool:
        """Whether the input of a network is 1 where an image is black, see `to_input`."""

    @property
    def reach_m(self) -> float:
        """How far the images show the pixels on the way of a miss as free [m], 0 if they do not."""

    def with_range(self, range_max_m: float) -> "Encoding":
        """Return the encoding for a lidar of another maximum range [m]."""

    def encode(self, scans: Scans, grid: Grid) -> np.ndarray:
        """Draw the images of a batch of scans, see `Scans.batched`, uint8, (B, C, H, W)."""


ENCODINGS: dict[str, type[Encoding]] = {  # by their names, without the number of parts
    "projection": Projection,
    "stack": Stack,
    "series": Series,
    "recent": Recent,
    "counts": Counts,
}


def create_encoding(name: str, parameters: dict[str, Any]) -> Encoding:
    """Create an encoding from its name and parameters; one that is None has its default.

    Raises:
        InputError: the name or a parameter is unknown, or a value is not allowed.
    """
    kind = ENCODINGS.get(kind_of(name))
    if kind is None:
        raise InputError(f"encoding must be one of {', '.join(ENCODINGS)}, got {name!r}")
    given = {key: value for key, value in parameters.items() if value is not None}
    known = list(signature(kind).parameters)
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise InputError(f"encoding {name} takes {', '.join(known)}, got {', '.join(unknown)}")
    try:
        encoding = kind(**given)
    except ValidationError as error:
        raise InputError("; ".join(str(fault) for fault in config_errors_of(error))) from error
    if encoding.name != name:
        raise InputError(f"encoding {name} does not match its parameters {parameters}, which describe {encoding.name}")
    return encoding


def to_input(images: np.ndarray, *, inverted: bool) -> np.ndarray:
    """Convert images, uint8, to the input of a network, float32 in [0, 1], of the same shape; inverted, black is 1.

    Adds in place, because the memory of a temporary is returned to the system and fetched again in every call.
    """
    values = images.astype(np.float32)
    if not inverted:
        return np.divide(values, 255, out=values)
    return np.add(np.divide(values, -255, out=values), 1, out=values)


def kind_of(name: str) -> str:
    """Return the name of an encoding without the number of its parts."""
    return name.rstrip("0123456789")
