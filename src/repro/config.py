"""The typed configuration: its values stand in conf/, Hydra composes them, `typed` checks them as a whole."""

import dataclasses
import enum
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from omegaconf import MISSING, DictConfig, OmegaConf
from pydantic import Field, TypeAdapter

NETWORKS = ("unet", "fpn", "upernet", "segformer")  # in the paper's order

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]


class Task(enum.Enum):
    """What a call does."""

    all = "all"
    record = "record"
    train = "train"
    evaluate = "evaluate"
    report = "report"
    plan = "plan"
    world = "world"
    publish = "publish"
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
        return variant(self.name, self.parameters.get("decay", True))


@dataclass(frozen=True)
class PairCounts:
    """Pairs of each split; a world and its twin are two."""

    train: Count
    val: Count
    test: Count


@dataclass(frozen=True)
class Scale:
    """How much of everything."""

    name: str
    size_px: Count
    pairs: PairCounts
    learning_rate: Positive
    batch_size: Count
    max_epochs: Count
    mirror: bool
    weight_average: Annotated[float, Field(gt=0, lt=1)] | None


@dataclass(frozen=True)
class Training:
    """How a network is trained; see conf/train."""

    learning_rate: Positive
    min_delta: NotNegative
    patience: Annotated[int, Field(ge=0)]
    batch_size: Count
    max_epochs: Count
    dice_eps: Positive
    mirror: bool = False
    weight_average: Annotated[float, Field(gt=0, lt=1)] | None = None


@dataclass(frozen=True)
class Runtime:
    """What may differ from one call to the next without making another run directory of it."""

    workers: Count
    accelerator: str
    precision: str
    compile: bool
    max_minutes: NotNegative | None


@dataclass(frozen=True)
class Config:
    """The whole configuration of a call."""

    task: Task
    exp: str
    decay: bool
    lightest: float
    seed: Annotated[int, Field(ge=0)]
    outputs: str
    world: dict[str, Any]
    encoding: Encoding
    model: Model
    scale: Scale
    train: Training
    runtime: Runtime


def schema(cls: type = Config) -> Any:
    """Makes the dataclass that Hydra composes into: the same fields, not frozen, none with a default."""
    fields: list[Any] = []
    for name, kind in get_type_hints(cls).items():
        is_part = isinstance(kind, type) and dataclasses.is_dataclass(kind)
        fields.append((name, schema(kind) if is_part else kind, dataclasses.field(default=MISSING)))
    return dataclasses.make_dataclass(cls.__name__, fields)


def typed(config: DictConfig) -> Config:
    """Gives a composed configuration its types.

    Raises:
        ValueError: values are out of their ranges; the message names every one.
    """
    return TypeAdapter(Config).validate_python(plain(config))


def plain(config: DictConfig) -> dict[str, Any]:
    """Resolves a part of the configuration to plain values."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def known_experiment(exp: str, experiments: Collection[str]) -> str:
    """Gives `exp` back, or ends with an error that lists the experiments there are."""
    if str(exp) not in experiments:
        raise SystemExit(f"unknown experiment exp={exp}; there are exp={', '.join(map(str, experiments))}")
    return str(exp)


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
