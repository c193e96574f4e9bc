"""Settings of a log, a stream and a node, each described once, with its limits.

A call, see `cli.settings`, uses the same types of fields.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from repro.logs.poses import MAX_PLACE_M
from repro.networks.predictor import Predictor
from repro.system.arrays import real
from repro.system.errors import InputError
from repro.system.fields import config_errors_of

MAX_AGE_STEPS = 5  # of the scan that stands in for a step; twice that between two scans divides a log
TOLERANCE = 1e-4  # of a step; times since 1970 in float64 are exact to 2e-7 s
MAX_RANGE_M = 10_000.0
MAX_MOUNTING_M = 10.0  # of a lidar from the middle of its robot
TURN = 2 * math.pi + 1e-3  # [rad], rounded


def _number(value: Any) -> int | float:
    """Return a number of NumPy, too, as one of Python."""
    try:
        array = real("", value, ())
    except InputError as error:
        raise InputError("must be a number") from error
    return float(array) if array.dtype.kind == "f" else int(array)


def _coordinates(expected: str, *most: float, **names: Any) -> BeforeValidator:
    """Return a validator that takes some names for what they mean, and coordinates, also as text with commas.

    Args:
        expected: what is expected, for messages.
        most: the largest absolute value of each coordinate.
        names: the meanings of names.
    """

    def check(value: Any) -> Any:
        if isinstance(value, str) and value in names:
            return names[value]
        try:
            words = map(float, value.split(",")) if isinstance(value, str) else value
            array = np.array([_number(word) for word in words])
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != (len(most),) or not (np.abs(array) <= most).all():  # false for NaN
            raise InputError(f"must be {expected}")
        return tuple(array.tolist())

    return BeforeValidator(check)


Steps = Annotated[int, BeforeValidator(_number), Field(ge=1, le=10_000)]  # of a window
# at least far above the resolution of times, so that a window has as many scans as steps [s]
StepTime = Annotated[float, BeforeValidator(_number), Field(ge=0.001, le=1000, allow_inf_nan=False)]
LidarRange = Annotated[float, BeforeValidator(_number), Field(ge=0.01, le=MAX_RANGE_M, allow_inf_nan=False)]  # [m]
Spacing = Literal["time", "distance"]
Misses = Literal["free", "invalid"]
Center = Annotated[
    Any, _coordinates("robot, start, or [x,y] in meters", MAX_PLACE_M, MAX_PLACE_M, robot="robot", start="start")
]
POSE = "[x,y,heading] in meters and radians, of a full turn at most, within"
Pose = Annotated[
    Any, _coordinates(f"fixed, or {POSE} {MAX_PLACE_M:g} m", MAX_PLACE_M, MAX_PLACE_M, TURN, fixed=(0.0, 0.0, 0.0))
]
Mounting = Annotated[Any, _coordinates(f"{POSE} {MAX_MOUNTING_M:g} m", MAX_MOUNTING_M, MAX_MOUNTING_M, TURN)]


@cache
def _adapters(kind: type) -> dict[str, TypeAdapter]:
    return {name: TypeAdapter(hint) for name, hint in get_type_hints(kind, include_extras=True).items()}


def convert_fields(settings: object) -> None:
    """Convert the fields of a new dataclass to their types.

    Raises:
        InputError: one has another type, or is outside of its limits.
    """
    for name, adapter in _adapters(type(settings)).items():  # type: ignore[arg-type]
        try:
            value = adapter.validate_python(getattr(settings, name))
        except ValidationError as error:
            raise InputError(str(config_errors_of(error, name)[0])) from error
        object.__setattr__(settings, name, value)


@dataclass(frozen=True)
class WindowSettings:
    """How windows are cut from scans.

    Args:
        center: center of the map: `robot` (the last pose of the window), `start` (the first pose of a log), or x, y in
            the frame of the poses [m].
        steps: steps of a window, T.
        step_s: time of a step [s]; with `distance`, scans between two steps.
        range_max_m: maximum range of the lidar [m], which replaces that of the scans; None keeps it.
        misses: `free`: a miss shows free space; or `invalid`: it shows nothing, as of lost beams, see `misses`.
        spacing: `time`, or `distance`: the scans of a log count as evenly spaced, and time is their number.

    Raises:
        InputError: a value is outside of its range.
    """

    center: Center = "robot"
    steps: Steps = 100
    step_s: StepTime = 0.1
    range_max_m: LidarRange | None = None
    spacing: Spacing = "time"
    misses: Misses = "free"

    def __post_init__(self) -> None:
        convert_fields(self)

    @property
    def duration_s(self) -> float:
        """Return the time from the first to the last step [s]."""
        return (self.steps - 1) * self.step_s

    def divides(self, gap_s: Any) -> Any:
        """Return whether no window has two kept scans, given the time between them [s], or the times."""
        return (gap_s > self.longest_gap_s) | (gap_s <= 0)

    @property
    def longest_gap_s(self) -> float:
        """Return the time between two scans beyond which no window has both [s]."""
        return (2 * MAX_AGE_STEPS + TOLERANCE) * self.step_s

    def origin(self, first: np.ndarray, last: np.ndarray, size_m: float) -> np.ndarray:
        """Return the lower left corner of a map [m], (2,), by the first pose of a log and the last one of a window."""
        centers = {"start": first[:2], "robot": last[:2]}
        return (centers[self.center] if isinstance(self.center, str) else np.array(self.center)) - size_m / 2

    def is_filled(self, first_s: float, end_s: float) -> bool:
        """Return whether the scans from a time on fill a window with this end [s]; its first scan may be half late."""
        return end_s - first_s >= self.duration_s - (0.5 + TOLERANCE) * self.step_s


def window_of(
    predictor: Predictor, steps: int | None = None, step_s: float | None = None, **others: Any
) -> WindowSettings:
    """Return the windows for a network, with the steps of its training where None is given, and other settings.

    Raises:
        InputError: a value is outside of its range, or the network has learned fixed obstacles and the center moves.
    """
    steps, step_s = predictor.steps if steps is None else steps, predictor.step_s if step_s is None else step_s
    settings, least = WindowSettings(steps=steps, step_s=step_s, **others), predictor.encoding.frames
    if settings.steps < least:
        raise InputError(f"steps: expected at least {least}, one for each part of the encoding, got {settings.steps}")
    predictor.check_center(settings.center)
    return settings


@dataclass(frozen=True)
class ReadOptions:
    """What a user knows of a log that its file does not say.

    Args:
        scan_topic: topic of the scans in a bag; None to find it.
        odometry_topic: topic of the odometry in a bag; None to find it.
        frame: frame of the poses in a bag, such as `odom`; None for the topmost one.
        pose: x, y [m] and heading [rad] of a lidar that stands; None for the poses of the log.
        mounting: x, y [m] and heading [rad] of the lidar on the robot; None for that of the log, in which the poses of
            an npz or a CARMEN log are those of the lidar.
    """

    scan_topic: str | None = None
    odometry_topic: str | None = None
    frame: str | None = None
    pose: Pose | None = None
    mounting: Mounting | None = None

    def __post_init__(self) -> None:
        convert_fields(self)
        others = {"frame": self.frame, "mounting": self.mounting, "odometry_topic": self.odometry_topic}
        unused = [name for name, value in others.items() if value is not None]
        if self.pose is not None and unused:
            raise InputError(f"pose: a lidar that stands needs no {' or '.join(unused)}: leave one out")
