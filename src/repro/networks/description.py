"""The description of a predictor, in predictor.json and in the metadata of ONNX files: its keys, types and ranges."""

import json
from typing import Annotated, Any, Literal, NotRequired

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict

from repro.fields import STRICT, Finite, config_errors_of, ordered
from repro.system.errors import InputError

MAX_ERRORS = 3  # in a message


Quantiles = Annotated[tuple[Finite, Finite, Finite, Finite, Finite], AfterValidator(ordered)]


@with_config(STRICT)
class EncodingOfScans(TypedDict):
    """Name and parameters of the encoding, which `encodings.create_encoding` checks."""

    name: str
    parameters: dict[str, Any]


@with_config(STRICT)
class GridOfMap(TypedDict):
    """Sides of the map, in the ranges of the configuration."""

    size_px: Annotated[int, Field(ge=32, le=4096, multiple_of=32)]
    size_m: Annotated[float, Field(ge=0.01, le=10_000, allow_inf_nan=False)]


@with_config(STRICT)
class WindowOfTraining(TypedDict, total=False):
    """The window, in the ranges of the configuration; files that are older than it have the defaults of `Predictor`."""

    steps: Annotated[int, Field(ge=1, le=30_000)]
    step_s: Annotated[float, Field(ge=1e-4, le=1000, allow_inf_nan=False)]
    has_fixed: bool
    is_centered: bool


@with_config(STRICT)
class StatisticsOfTraining(TypedDict):
    """See `statistics.Statistics`."""

    windows: Annotated[int, Field(ge=1)]
    quantiles: dict[str, Quantiles]


@with_config(STRICT)
class Description(TypedDict):
    """All keys but the checksum; `architecture` is that of a network of torch, `channels` are those of an ONNX file."""

    architecture: NotRequired[str]
    channels: NotRequired[Annotated[int, Field(ge=1, le=1000)]]
    encoding: EncodingOfScans
    grid: GridOfMap
    window: NotRequired[WindowOfTraining]
    statistics: NotRequired[StatisticsOfTraining]


def checked(content: dict[str, Any], required: Literal["architecture", "channels"]) -> Description:
    """Check the description of a predictor.

    Args:
        content: the description as read from JSON, without its checksum.
        required: the key that this kind of file has as well.

    Raises:
        ValueError: a key is unknown or missing, or a value has another type or is out of range.
    """
    if required not in content:
        raise InputError(f"{required}: is missing")
    try:
        return TypeAdapter(Description).validate_json(json.dumps(content))  # JSON, for strict types and lists as tuples
    except ValidationError as error:
        errors = config_errors_of(error)
        more = f"; and {len(errors) - MAX_ERRORS} more" if len(errors) > MAX_ERRORS else ""
        raise InputError("; ".join(map(str, errors[:MAX_ERRORS])) + more) from error
