"""The typed configuration: its values stand in conf/, Hydra composes them, `checks` finds what is wrong."""

import dataclasses
import enum
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from omegaconf import MISSING, DictConfig, OmegaConf
from pydantic import AfterValidator, Field, TypeAdapter

NETWORKS = ("unet", "fpn", "upernet", "segformer")  # in the paper's order
LEARNED = (*NETWORKS, "convlstm")  # and ours, which takes a series of images

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(gt=0, lt=1)]
Even = Annotated[int, Field(ge=2, le=2_000_000, multiple_of=2)]
PRECISIONS = ("32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true")  # as Lightning names them
MOST_WORKERS = max(8, 2 * (os.cpu_count() or 1))


def choice(*allowed: str) -> AfterValidator:
    """Creates a check that a value is one of a list."""

    def check(value: str) -> str:
        if value not in allowed:
            raise ValueError(f"must be one of {', '.join(allowed)}")
        return value

    return AfterValidator(check)


class Task(enum.Enum):
    """What a call does."""

    all = "all"
    record = "record"
    train = "train"
    evaluate = "evaluate"
    report = "report"
    evidence = "evidence"
    curves = "curves"
    transfer = "transfer"
    animate = "animate"
    plan = "plan"
    status = "status"
    world = "world"
    publish = "publish"
    verify = "verify"
    export = "export"
    readme = "readme"


@dataclass(frozen=True)
class Model:
    """What predicts: a network with its encoder, or by its name alone a rival that learns nothing."""

    name: str
    encoder_name: str | None = None
    encoder_weights: str | None = None


@dataclass(frozen=True)
class Encoding:
    """How scans become the network's input: a name and what `maps.encodings.create_encoding` takes with it."""

    name: str
    parameters: dict[str, Any]

    @property
    def variant(self) -> str:
        """Names it in paths: `decay` and `no-decay` for the paper's, its name for any other."""
        return variant(self.name, self.decay)

    @property
    def decay(self) -> bool:
        """Whether its images fade with age."""
        return self.parameters.get("decay", True)


@dataclass(frozen=True)
class PairCounts:
    """Pairs of each split; a world and its twin are two."""

    train: Even
    val: Even
    test: Even


@dataclass(frozen=True)
class Scale:
    """How much of everything."""

    name: Annotated[str, Field(pattern=r"^[\w-]+$")]
    size_px: Annotated[int, Field(ge=32, le=4096, multiple_of=32)]  # the encoder halves its images five times
    pairs: PairCounts
    learning_rate: Positive
    batch_size: Annotated[int, Field(ge=2)]
    max_epochs: Count
    flip_augmentation: bool
    ema_decay: Share | None


@dataclass(frozen=True)
class Training:
    """How a network is trained; see conf/train."""

    learning_rate: Positive
    min_delta: NotNegative
    patience: Annotated[int, Field(ge=0)]
    batch_size: Annotated[int, Field(ge=2)]  # batch norm needs two
    max_epochs: Count
    dice_eps: Positive
    flip_augmentation: bool = False
    ema_decay: Share | None = None


@dataclass(frozen=True)
class Runtime:
    """What may differ from one call to the next without making another run directory of it."""

    workers: Annotated[int, Field(ge=1, le=MOST_WORKERS)]
    accelerator: Annotated[str, choice("auto", "cpu", "gpu")]
    precision: Annotated[str, choice("auto", *PRECISIONS)]
    compile: bool
    max_minutes: NotNegative | None
    part: Annotated[int, Field(ge=0)]
    parts: Count


@dataclass(frozen=True)
class Publish:
    """How results are published."""

    force: bool


@dataclass(frozen=True)
class Config:
    """The whole configuration of a call."""

    task: Task
    exp: str
    decay: bool
    oldest_gray: Annotated[float, Field(ge=0, lt=1)]
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    outputs: Annotated[str, Field(min_length=1)]
    recordings: Annotated[str, Field(min_length=1)]
    world: dict[str, Any]
    encoding: Encoding
    model: Model
    scale: Scale
    train: Training
    runtime: Runtime
    publish: Publish


def schema(cls: type = Config) -> Any:
    """Makes the dataclass that Hydra composes into: the same fields, not frozen, none with a default."""
    fields: list[Any] = []
    for name, kind in get_type_hints(cls).items():
        is_part = isinstance(kind, type) and dataclasses.is_dataclass(kind)
        fields.append((name, schema(kind) if is_part else kind, dataclasses.field(default=MISSING)))
    return dataclasses.make_dataclass(cls.__name__, fields)


def to_typed(values: dict[str, Any]) -> Config:
    """Gives the plain values of a checked configuration their types."""
    return TypeAdapter(Config).validate_python(values)


def plain(config: DictConfig) -> dict[str, Any]:
    """Resolves a part of the configuration to plain values."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def variant(encoding: str, decay: bool) -> str:
    """Names an encoding in paths, see `Encoding.variant`."""
    if encoding == "projection":
        return "decay" if decay else "no-decay"
    return encoding if decay else f"{encoding}-no-decay"


def read_world(path: Path) -> dict[str, Any]:
    """Reads a file of conf/world by itself, its references meaning what they mean in the whole configuration."""
    return plain(OmegaConf.create({"world": OmegaConf.load(path)}))["world"]


def world_spec(world: dict[str, Any], experiment: str) -> dict[str, Any]:
    """Takes from `world` what decides the worlds of an experiment, as `worlds.sample_world` takes it."""
    return {
        "experiment": experiment,
        "world": world["world"],
        "robot": world["robot"],
        **world["experiments"][experiment],
    }
