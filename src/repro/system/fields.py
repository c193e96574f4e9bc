"""Types of fields with their ranges, for pydantic, and the error that names a wrong value."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import ConfigDict, Field, ValidationError

from repro.system.errors import InputError

LONGEST = 200  # characters of a value in a message
UNKNOWN_KEY = "is not a known key"
OLDEST_GRAY = 0.8  # default in conf/config.yaml

KNOWN_KEYS = ConfigDict(extra="forbid")  # unknown keys are errors, and values are converted to their types
STRICT = ConfigDict(extra="forbid", strict=True)  # values of other types are errors as well
Finite = Annotated[float, Field(allow_inf_nan=False)]
MaximumRange = Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]  # [m], as that of the lidar of a world
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Epochs = Annotated[int, Field(ge=1, le=100_000)]
SmallPositive = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, lt=1)]
Even = Annotated[int, Field(ge=2, le=2_000_000, multiple_of=2)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
Gray = Annotated[float, Field(ge=0, le=254 / 255, allow_inf_nan=False)]  # of a hit; 0 is black, 1 the white background
FrameCount = Annotated[int, Field(ge=1, le=100)]


def ordered(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Check in a pydantic validator that values do not decrease."""
    if sorted(values) != list(values):
        raise InputError("must be ordered, low to high")
    return values


class WrongValues(InputError):
    """Several values are wrong; the arguments are their config errors."""


@dataclass(frozen=True)
class ConfigError:
    """A wrong value of the configuration: its key, the value received (None when missing) and what is expected."""

    key: str
    value: Any
    expected: str

    def __str__(self) -> str:
        if self.value is None:
            return f"{self.key}: {self.expected}"
        value = str(self.value)
        return f"{self.key}={value if len(value) <= LONGEST else value[:LONGEST] + '...'}: {self.expected}"


def config_errors_of(error: ValidationError, prefix: str = "", values: Any = None) -> list[ConfigError]:
    """Convert the errors of pydantic, with keys written as on the command line after `prefix`.

    The names that pydantic adds to the path of a value in a union are left out, if the validated `values` are given.
    """
    errors = []
    known = dict.fromkeys(("extra_forbidden", "unexpected_keyword_argument"), UNKNOWN_KEY)
    known |= {"missing": "is missing", "string_pattern_mismatch": "must be letters, digits, _ and - only"}
    for found in error.errors():
        path = found["loc"] if values is None else _keys_in(values, found["loc"], is_missing=found["type"] == "missing")
        key = prefix + ".".join(str(part) for part in path)
        if found["type"] in ("union_tag_invalid", "union_tag_not_found"):  # the name of one of several parts
            errors.append(_error_of_tag(key, found.get("ctx", {})))
            continue
        message = known.get(found["type"], re.sub(r"^\w+ should", "must", found["msg"].removeprefix("Value error, ")))
        value = None if found["type"] == "missing" else found["input"]
        errors.append(ConfigError(key, value, message))
    return errors


def _keys_in(values: Any, path: tuple[str | int, ...], *, is_missing: bool) -> Iterator[str | int]:
    """Yield those keys of a path that are in some values, and the last one if it is missing there."""
    for place, key in enumerate(path):
        known = values if isinstance(values, dict) else range(len(values)) if isinstance(values, list) else ()
        if key in known:
            values = values[key]
            yield key
        elif is_missing and place == len(path) - 1:
            yield key


def _error_of_tag(key: str, context: dict[str, Any]) -> ConfigError:
    """Return the error of a value whose name, by which its type is chosen, is unknown or missing."""
    name, tags = str(context["discriminator"]).strip("'"), context.get("expected_tags")
    if tags is None:
        return ConfigError(key, None, f"needs a {name}")
    return ConfigError(key, None, f"the {name} {context['tag']} must be one of {tags.replace(chr(39), '')}")
