"""The configuration of a call, as Hydra composes it from conf/."""

import dataclasses
import os
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

from omegaconf import MISSING
from pydantic import AfterValidator, Field, TypeAdapter

from repro.config import STRICT, Encoding, Gray, Model, NotNegative, Scale, Training, choice

RUN_TASKS = ("all", "record", "train", "evaluate", "world", "animate", "generalization", "export")
STUDY_TASKS = ("report", "analysis", "curves", "plan", "status", "publish", "verify", "docs")  # once for all runs
PRECISIONS = ("32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true")  # Lightning's names
Directory = Annotated[str, Field(min_length=1), AfterValidator(os.path.expanduser)]
MAX_WORKERS = max(8, 2 * (os.cpu_count() or 1))


@dataclass(frozen=True)
class Runtime:
    """Settings that may differ between calls of the same run."""

    __pydantic_config__ = STRICT

    workers: Annotated[int, Field(ge=1, le=MAX_WORKERS)]
    accelerator: Annotated[str, choice("auto", "cpu", "gpu")]
    precision: Annotated[str, choice("auto", *PRECISIONS)]
    compile: bool
    max_minutes: NotNegative | None
    part: Annotated[int, Field(ge=0)]
    parts: Annotated[int, Field(ge=1, le=10_000)]


@dataclass(frozen=True)
class Publish:
    """Settings of task=publish and task=export."""

    __pydantic_config__ = STRICT

    force: bool


@dataclass(frozen=True)
class Config:
    """The whole configuration of a call."""

    __pydantic_config__ = STRICT

    task: Annotated[str, choice(*RUN_TASKS, *STUDY_TASKS)]
    exp: str
    decay: bool
    oldest_gray: Gray
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    outputs: Directory
    recordings: Directory
    world: dict[str, Any]
    encoding: Encoding
    model: Model
    scale: Scale
    train: Training
    runtime: Runtime
    publish: Publish


def schema(cls: type = Config) -> Any:
    """Create the dataclass that Hydra composes into: the same fields, not frozen, required unless they have a default.

    The training settings have none, since conf/train states all of them.
    """
    fields: list[Any] = []
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    for name, kind in get_type_hints(cls).items():
        is_part = isinstance(kind, type) and dataclasses.is_dataclass(kind)
        default = defaults[name] if cls is Model and defaults[name] is not NO_DEFAULT else MISSING
        fields.append((name, schema(kind) if is_part else kind, dataclasses.field(default=default)))
    return dataclasses.make_dataclass(cls.__name__, fields)


def to_typed(values: dict[str, Any]) -> Config:
    """Convert plain values to the typed configuration.

    Raises:
        pydantic.ValidationError: a value is not allowed.
    """
    return TypeAdapter(Config).validate_python(values)
