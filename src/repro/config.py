"""The typed configuration: its values stand in conf/, Hydra composes them, `typed` checks them as a whole."""

import dataclasses
import enum
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from omegaconf import MISSING, DictConfig, OmegaConf
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

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
    mirror: bool
    weight_average: Share | None


@dataclass(frozen=True)
class Training:
    """How a network is trained; see conf/train."""

    learning_rate: Positive
    min_delta: NotNegative
    patience: Annotated[int, Field(ge=0)]
    batch_size: Annotated[int, Field(ge=2)]  # batch norm needs two
    max_epochs: Count
    dice_eps: Positive
    mirror: bool = False
    weight_average: Share | None = None


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
    lightest: Annotated[float, Field(ge=0, lt=1)]
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


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a configuration: its key, what came, and what is allowed."""

    key: str
    value: Any
    allowed: str

    def __str__(self) -> str:
        return f"{self.key}: {self.allowed}" if self.value is None else f"{self.key}={self.value}: {self.allowed}"


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


def config_faults(values: dict[str, Any]) -> list[Fault]:
    """Finds everything that is wrong with a configuration but for `world`, see `simulation.specs.world_faults`.

    Args:
        values: the whole configuration as plain values.

    Returns:
        the faults, each value by itself first, then what only shows together.
    """
    try:
        config = TypeAdapter(Config).validate_python(values)
    except ValidationError as error:
        faults = faults_of(error)
        keys = {fault.key for fault in faults}  # conf/train takes some of its values from the scale
        return [f for f in faults if not (f.key.startswith("train.") and f.key.replace("train", "scale") in keys)]
    faults = []
    if config.exp not in config.world.get("experiments", {}):
        faults.append(Fault("exp", config.exp, f"there are {', '.join(config.world.get('experiments', {}))}"))
    if config.train.batch_size > config.scale.pairs.train:
        allowed = f"at most the {config.scale.pairs.train} training pairs"
        faults.append(Fault("train.batch_size", config.train.batch_size, allowed))
    if not config.decay and "decay" not in config.encoding.parameters:
        faults.append(Fault("decay", "false", f"the encoding {config.encoding.name} has no decay to be left out"))
    if config.runtime.part >= config.runtime.parts:
        faults.append(Fault("runtime.part", config.runtime.part, f"must be below runtime.parts={config.runtime.parts}"))
    if config.model.name not in LEARNED:
        faults.append(Fault("model.name", config.model.name, f"must be one of {', '.join(LEARNED)}"))
    if config.model.name == "convlstm" and "frames" not in config.encoding.parameters:
        allowed = "model convlstm takes a series of images, encoding=stack10 or encoding=stack4"
        faults.append(Fault("encoding", config.encoding.name, allowed))
    return faults


def faults_of(error: ValidationError, prefix: str = "") -> list[Fault]:
    """Turns what pydantic found into faults, keys written as on the command line."""
    faults = []
    for found in error.errors():
        key = prefix + ".".join(str(part) for part in found["loc"])
        known = {
            "extra_forbidden": "is not known here",
            "missing": "is missing",
        }
        message = known.get(found["type"], found["msg"].removeprefix("Value error, ").replace("Input should", "must"))
        value = None if found["type"] == "missing" else found["input"]
        faults.append(Fault(key, value, message))
    return faults


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
