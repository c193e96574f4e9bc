"""The configuration of a call, as Hydra composes it from conf/."""

import dataclasses
import math
import os
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

from omegaconf import MISSING
from pydantic import AfterValidator, Field, TypeAdapter

from repro.config import Encoding, Scale, Training
from repro.fields import KNOWN_KEYS, Gray, NotNegative, choice
from repro.networks.model import Model
from repro.system.errors import InputError

RUN_TASKS = (
    *("all", "record", "train", "evaluate", "world", "animate"),
    *("generalization", "export", "predict"),
)
TRAINING_TASKS = ("all", "train")
# once for all runs:
STUDY_TASKS = ("report", "analysis", "curves", "plan", "status", "publish", "verify", "docs", "demo", "floor")
PRECISIONS = ("32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true")  # Lightning's names
Directory = Annotated[str, Field(min_length=1), AfterValidator(os.path.expanduser)]
MAX_WORKERS = max(8, 2 * (os.cpu_count() or 1))


@dataclass(frozen=True)
class Runtime:
    """Settings that may differ between calls of the same run."""

    __pydantic_config__ = KNOWN_KEYS

    workers: Annotated[int, Field(ge=1, le=MAX_WORKERS)]
    accelerator: Annotated[str, choice("auto", "cpu", "gpu")]
    precision: Annotated[str, choice("auto", *PRECISIONS)]
    compile: bool
    max_minutes: NotNegative | None
    part: Annotated[int, Field(ge=0)]
    parts: Annotated[int, Field(ge=1, le=10_000)]


def _is_center(value: Any) -> Any:
    is_point = isinstance(value, list) and len(value) == 2 and all(type(number) in (int, float) for number in value)
    if value not in ("robot", "start") and not (is_point and all(map(math.isfinite, value))):
        raise InputError("must be robot, start, or [x,y] in meters")
    return value


@dataclass(frozen=True)
class Prediction:
    """Settings of task=predict.

    Args:
        weights: a run, its model directory, an exported directory, or an ONNX file.
        steps: steps of a window, T; None for those of the training.
        step_s: time of a step [s]; None for that of the training.
        stride_s: time between two windows [s].
        center: center of the map: robot, start, or x, y in the frame of the log [m].
        fov_deg: field of view to crop the scans to [degrees]; None keeps all beams.
        range_max_m: maximum range of the lidar [m]; None for that of the log.
        animate: whether to write an animation of all windows.
        scan_topic: topic of the scans in a bag; None to find it.
        odometry_topic: topic of the odometry in a bag; None to find it.
        mcap: whether to write an MCAP file, too.
    """

    __pydantic_config__ = KNOWN_KEYS

    weights: Directory
    steps: Annotated[int, Field(ge=1, le=10_000)] | None
    step_s: Annotated[float, Field(ge=0.001, le=1000, allow_inf_nan=False)] | None
    stride_s: Annotated[float, Field(ge=0.001, le=1e6, allow_inf_nan=False)]
    center: Annotated[Any, AfterValidator(_is_center)]
    fov_deg: Annotated[float, Field(ge=10, le=360, allow_inf_nan=False)] | None
    range_max_m: Annotated[float, Field(ge=0.01, le=10_000, allow_inf_nan=False)] | None
    animate: bool
    scan_topic: str | None
    odometry_topic: str | None
    mcap: bool


@dataclass(frozen=True)
class Demo:
    """Settings of task=demo.

    Args:
        networks: directories of trained or exported networks; the page starts with the first.
        runtime: npm package of ONNX Runtime Web; None takes it from the user's cache or downloads it.
    """

    __pydantic_config__ = KNOWN_KEYS

    networks: Annotated[list[Directory], Field(min_length=1)]
    runtime: Directory | None


@dataclass(frozen=True)
class Publish:
    """Settings of task=publish and task=export.

    Args:
        force: replace published results against the checks.
    """

    __pydantic_config__ = KNOWN_KEYS

    force: bool


@dataclass(frozen=True)
class Config:
    """The whole configuration of a call."""

    __pydantic_config__ = KNOWN_KEYS

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
    format: Annotated[str, choice("torch", "onnx")]
    scans: Directory | None
    floor_map: Directory | None
    prediction: Prediction
    demo: Demo
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
