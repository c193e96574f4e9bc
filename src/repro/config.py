"""Typed parts of the configuration that decide a result, and the error type that names a wrong value.

The values themselves are in conf/, Hydra composes them, `cli.validation` checks them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from omegaconf import DictConfig, OmegaConf
from pydantic import AfterValidator, ConfigDict, Field, ValidationError
from typing_extensions import TypedDict

from repro.system.errors import InputError

NETWORKS = ("unet", "fpn", "upernet", "segformer")  # the paper's four, in its order
PAPER_ENCODER = "mit_b0"
LONGEST = 200  # characters of a value in a message
UNKNOWN_KEY = "is not a known key"

KNOWN_KEYS = ConfigDict(extra="forbid")  # unknown keys are errors, and values are converted to their types
STRICT = ConfigDict(extra="forbid", strict=True)  # values of other types are errors as well
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
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


def choice(*allowed: str) -> AfterValidator:
    """Return a pydantic validator that accepts one of a list of strings."""

    def check(value: str) -> str:
        if value not in allowed:
            raise InputError(f"must be one of {', '.join(allowed)}")
        return value

    return AfterValidator(check)


@dataclass(frozen=True)
class Model:
    """A network and its encoder, or a baseline, which has a name alone.

    Args:
        name: name of the model in paths and tables.
        architecture: one of our own (`networks.create`) or of segmentation-models-pytorch; None means the name is one.
        encoder_name: encoder of segmentation-models-pytorch; None for a network with an encoder of its own.
        encoder_weights: pretrained weights of the encoder; None trains from scratch.
        parameters: further parameters of one of our own networks.
    """

    __pydantic_config__ = KNOWN_KEYS

    name: Name
    architecture: str | None = None
    encoder_name: str | None = None
    encoder_weights: str | None = None
    parameters: dict[str, Any] = field(default_factory=dict, hash=False)

    @property
    def kind(self) -> str:
        """Name of the architecture."""
        return self.architecture or self.name


def paper_model(name: str) -> Model:
    """Return one of the paper's networks with the paper's encoder, trained from scratch."""
    return Model(name, encoder_name=PAPER_ENCODER)


@dataclass(frozen=True)
class Encoding:
    """How scans become the input of a network: a name and the parameters of `maps.encodings.create_encoding`."""

    __pydantic_config__ = KNOWN_KEYS

    name: Name
    parameters: dict[str, Any]

    @property
    def label(self) -> str:
        """Name of the encoding in paths and tables: its name, with `-no-decay` in the ablation."""
        return self.name if self.decay else f"{self.name}{NO_DECAY}"

    @property
    def decay(self) -> bool:
        """Whether the gray of a hit depends on its age."""
        return self.parameters.get("decay", True)

    @property
    def most_channels(self) -> int:
        """Number of images of the encoding, or more, without creating it."""
        return most_channels(self.parameters)


def most_channels(parameters: Mapping[str, Any]) -> int:
    """Return the number of images of an encoding, or more, from its parameters."""
    return MOST_CHANNELS * parameters.get("frames", 1)


class EncodingParameters(TypedDict, total=False):
    """Types and ranges of the parameters of the encodings in `maps.encodings`; those of other encodings are theirs."""

    __pydantic_config__ = ConfigDict(extra="allow", strict=True)  # type: ignore[misc]

    decay: bool
    oldest_gray: Gray
    half_life: Positive
    range_max_m: Positive
    frames: FrameCount


class NetworkParameters(TypedDict, total=False):
    """Types and ranges of the parameters of the recurrent networks in `networks`."""

    __pydantic_config__ = ConfigDict(extra="allow", strict=True)  # type: ignore[misc]

    hidden: Annotated[int, Field(ge=16, le=512, multiple_of=16)]
    stride: Literal[2, 4]


NO_DECAY = "-no-decay"
MOST_CHANNELS = 2  # of an encoding in each part of the window
OLDEST_GRAY = 0.8  # default in conf/config.yaml
RECURRENT = ("convgru", "convlstm", "deeptracking", "light_convgru")  # architectures that need a series of images
LOSSES = ("map", "visible")  # see `learning.losses`
EVERY_PART = ("deeptracking",)  # architectures that predict a map after every part of a series, for the loss `visible`
PROJECTION = "projection"  # the paper's input
PROJECTION_NO_DECAY = PROJECTION + NO_DECAY  # the input of its ablation


@dataclass(frozen=True)
class PairCounts:
    """Number of pairs in each split; a world and its twin are two."""

    __pydantic_config__ = KNOWN_KEYS

    train: Even
    val: Even
    test: Even


@dataclass(frozen=True)
class Scale:
    """Resolution, amount of data and training schedule; see conf/scale.

    Args:
        takes: how long the study takes, in words.
    """

    __pydantic_config__ = KNOWN_KEYS

    name: Name
    takes: str
    size_px: Annotated[int, Field(ge=32, le=4096, multiple_of=32)]  # the encoder halves its images five times
    pairs: PairCounts
    learning_rate: SmallPositive
    batch_size: Annotated[int, Field(ge=2)]
    max_epochs: Epochs
    flip_augmentation: bool
    ema_decay: Share | None


@dataclass(frozen=True)
class Training:
    """Training settings of a network; see conf/train."""

    __pydantic_config__ = KNOWN_KEYS

    learning_rate: SmallPositive
    min_delta: Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False)]
    patience: Annotated[int, Field(ge=0)]
    batch_size: Annotated[int, Field(ge=2)]  # batch normalization needs two
    max_epochs: Epochs
    dice_eps: SmallPositive
    flip_augmentation: bool = False
    ema_decay: Share | None = None
    loss: Annotated[str, choice(*LOSSES)] = "map"


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


def config_errors_of(error: ValidationError, prefix: str = "") -> list[ConfigError]:
    """Convert the errors of pydantic, with keys written as on the command line after `prefix`."""
    errors = []
    known = dict.fromkeys(("extra_forbidden", "unexpected_keyword_argument"), UNKNOWN_KEY)
    known |= {"missing": "is missing", "string_pattern_mismatch": "must be letters, digits, _ and - only"}
    for found in error.errors():
        key = prefix + ".".join(str(part) for part in found["loc"])
        if found["type"] in ("union_tag_invalid", "union_tag_not_found"):  # the name of one of several parts
            errors.append(_error_of_tag(key, found.get("ctx", {})))
            continue
        message = known.get(found["type"], found["msg"].removeprefix("Value error, ").replace("Input should", "must"))
        value = None if found["type"] == "missing" else found["input"]
        errors.append(ConfigError(key, value, message))
    return errors


def _error_of_tag(key: str, context: dict[str, Any]) -> ConfigError:
    """Return the error of a value whose name, by which its type is chosen, is unknown or missing."""
    name, tags = str(context["discriminator"]).strip("'"), context.get("expected_tags")
    if tags is None:
        return ConfigError(key, None, f"needs a {name}")
    return ConfigError(key, None, f"the {name} {context['tag']} must be one of {tags.replace(chr(39), '')}")


def plain(config: DictConfig) -> dict[str, Any]:
    """Return a part of the configuration as plain values, its interpolations resolved."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]
