"""Settings of a call that do not decide the result of a run: how it is computed, and what single tasks take.

conf/config.yaml explains them, with units and defaults.
"""

import os
import stat
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Field, model_validator

from repro.cli.refusals import Refused
from repro.logs.options import Center, LidarRange, Misses, Mounting, Pose, Spacing, Steps, StepTime
from repro.runs.parallel import has_gpu
from repro.system.errors import InputError
from repro.system.fields import KNOWN_KEYS, Name, NotNegative

Precision = Literal["auto", "32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true"]  # of Lightning
MAX_WORKERS = max(8, 2 * (os.cpu_count() or 1))


def _is_there(name: str) -> str:
    """Check that a file or directory exists, without opening it: a pipe would wait, a device never end."""
    try:
        mode = os.stat(name).st_mode
    except OSError as error:
        raise InputError(str(error.strerror)) from error
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError("is neither a file nor a directory")
    return name


Text = Annotated[str, Field(min_length=1)]
UserPath = Annotated[Text, AfterValidator(os.path.expanduser)]


def _files(value: Any) -> list[str]:
    """Return one file, or a list of files, as a list."""
    names = value if isinstance(value, list) else [value]
    if not names or not all(isinstance(name, str) and name for name in names):
        raise InputError("must be a file, or a list of files, [a.bag,b.bag]")
    try:
        return [_is_there(os.path.expanduser(name)) for name in names]
    except InputError as error:
        raise InputError(str(error) if len(names) == 1 else f"{error}, one of them") from error


Files = Annotated[Any, AfterValidator(_files)]  # validated to a list of names


def _has_device(accelerator: str) -> str:
    if accelerator == "gpu" and not has_gpu():
        raise InputError("no CUDA GPU is visible; use auto or cpu")
    return accelerator


@dataclass(frozen=True)
class Runtime:
    """Settings that may differ between calls of the same run."""

    __pydantic_config__ = KNOWN_KEYS

    workers: Annotated[int, Field(ge=1, le=MAX_WORKERS)]
    accelerator: Annotated[Literal["auto", "cpu", "gpu"], AfterValidator(_has_device)]
    precision: Precision
    max_minutes: NotNegative | None

    @model_validator(mode="after")
    def _can_be_computed(self) -> "Runtime":
        if self.precision.startswith("16") and (self.accelerator == "cpu" or not has_gpu()):
            raise Refused(f"runtime.precision={self.precision}: float16 needs a GPU, use auto, 32-true or bf16-mixed")
        return self


@dataclass(frozen=True)
class Prediction:
    """Settings of task=predict, of which those of a stream and a node are described in `logs.options`."""

    __pydantic_config__ = KNOWN_KEYS

    weights: UserPath
    steps: Steps | None
    step_s: StepTime | None
    stride_s: Annotated[float, Field(ge=0.001, le=1e6, allow_inf_nan=False)]
    spacing: Spacing | None
    center: Center
    pose: Pose | None
    mounting: Mounting | None
    fov_deg: Annotated[float, Field(ge=10, le=360, allow_inf_nan=False)] | None
    range_max_m: LidarRange | None
    misses: Misses
    scan_topic: str | None
    odometry_topic: str | None
    frame: str | None


@dataclass(frozen=True)
class Adaptation:
    """Settings of task=adapt."""

    __pydantic_config__ = KNOWN_KEYS

    logs: Files | None
    name: Name | None


NETWORK = "network"  # of the network of the call
Classical = Literal["scan", "keep", "decay", "log_odds", "tracker", "full_circle", "truth", "true_velocities"]
MAPPERS = get_args(Classical)
SeedCount = Annotated[int, Field(ge=1, le=10_000)]  # the courses of the test follow those of the validation


@dataclass(frozen=True)
class Navigation:
    """Settings of task=navigate."""

    __pydantic_config__ = KNOWN_KEYS

    mapper: Literal[Classical, "network"]
    experiments: Annotated[list[Name], Field(min_length=1)]
    validation_seeds: SeedCount
    test_seeds: SeedCount


@dataclass(frozen=True)
class Demo:
    """Settings of task=demo."""

    __pydantic_config__ = KNOWN_KEYS

    networks: Annotated[list[UserPath], Field(min_length=1)]


@dataclass(frozen=True)
class Publish:
    """Settings of task=publish and task=export."""

    __pydantic_config__ = KNOWN_KEYS

    force: bool
