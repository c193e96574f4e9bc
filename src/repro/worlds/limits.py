"""What all sections of a file of conf/world are made of: their base, and types of fields with their limits.

Within the limits, IR-SIM, the recorder and float32 compute what the value says.
"""

import itertools
import math
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag

from repro.system.errors import InputError
from repro.system.fields import STRICT, ordered

T = TypeVar("T")


def _one_or_several(value: Any) -> str:
    return "<several>" if isinstance(value, list | tuple) else "<one>"


Range = Annotated[tuple[T, T], AfterValidator(ordered)]
OneOrRange = Annotated[
    Annotated[T, Tag("<one>")] | Annotated[Range[T], Tag("<several>")], Discriminator(_one_or_several)
]
OneOrList = Annotated[
    Annotated[T, Tag("<one>")] | Annotated[list[T], Field(max_length=100), Tag("<several>")],
    Discriminator(_one_or_several),
]
Length = Annotated[float, Field(ge=0.01, le=10_000, allow_inf_nan=False)]  # [m]
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]  # [m]
Point = tuple[Coordinate, Coordinate]
Duration = Annotated[float, Field(ge=1e-4, le=1000, allow_inf_nan=False)]  # [s]
Speed = Annotated[float, Field(ge=1e-6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
Limit = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi, allow_inf_nan=False)]  # [rad]
Ratio = Annotated[float, Field(ge=0.01, le=100, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]
Steps = Annotated[int, Field(ge=1, le=1_000_000)]
WindowSteps = Annotated[int, Field(ge=2, le=1_000_000)]  # steps
Number = Annotated[int, Field(ge=1, le=1000)]


class Section(BaseModel):
    model_config = ConfigDict(**STRICT, frozen=True)

    def irsim(self) -> dict[str, Any]:
        """Return the section as IR-SIM reads it, with the keys that were given."""
        return self.model_dump(mode="json", exclude_unset=True)


def distinct(points: list[Point]) -> list[Point]:
    if any(a == b for a, b in itertools.pairwise(points)):
        raise InputError("must not name the same point twice in a row")
    return points
