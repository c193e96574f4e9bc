"""Schema of conf/world: the allowed keys and the range of every value.

The models mirror conf/world/paper.yaml. Unknown keys are rejected by name, because IR-SIM would apply them and the
recorder would ignore them.
"""

import json
import math
import re
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from repro.config import ConfigError, config_errors_of
from repro.simulation.motions import robot_commands
from repro.simulation.worlds import check_spec, sample_world


def _ordered(pair: tuple) -> tuple:
    if pair[0] > pair[1]:
        raise ValueError("must be ordered, low to high")
    return pair


MAX_READINGS = 2_000_000  # of a recording; a shard of a hundred recordings is held in memory, 4 bytes each

# Ranges in which IR-SIM, the recorder and float32 compute what the value says
Length = Annotated[float, Field(ge=0.01, le=10_000, allow_inf_nan=False)]  # [m]
LengthRange = Annotated[tuple[Length, Length], AfterValidator(_ordered)]
Duration = Annotated[float, Field(ge=1e-4, le=1000, allow_inf_nan=False)]  # [s]
Speed = Annotated[float, Field(ge=1e-6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
SpeedRange = Annotated[tuple[Speed, Speed], AfterValidator(_ordered)]
Limit = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
Ratio = Annotated[float, Field(ge=0.01, le=100, allow_inf_nan=False)]
RatioRange = Annotated[tuple[Ratio, Ratio], AfterValidator(_ordered)]
Steps = Annotated[int, Field(ge=1, le=1_000_000)]
StepsRange = Annotated[tuple[Steps, Steps], AfterValidator(_ordered)]
Number = Annotated[int, Field(ge=1, le=10_000)]
NumberRange = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class World(_Part):
    """The map; obstacles may pass through one another, as they do in the recorder."""

    width: Length
    height: Length
    step_time: Duration
    collision_mode: Literal["unobstructed"]


class Lidar(_Part):
    """IR-SIM's lidar without noise, at the center of the robot."""

    type: Literal["lidar2d"]
    range_min: Literal[0] = 0
    range_max: Length
    angle_range: Annotated[float, Field(ge=0.001, le=2 * math.pi, allow_inf_nan=False)]
    number: Annotated[int, Field(ge=2, le=100_000)]


class Kinematics(_Part):
    name: Literal["diff"]


class Disc(_Part):
    name: Literal["circle"]
    radius: Length


class Robot(_Part):
    """A disc-shaped differential-drive robot with one lidar; its start pose follows from the motion."""

    kinematics: Kinematics
    shape: Disc
    vel_min: tuple[Limit, Limit]
    vel_max: tuple[Speed, Speed]
    sensors: Annotated[list[Lidar], Field(min_length=1, max_length=1)]


class Rotation(_Part):
    name: Literal["rotate"]
    steps: Annotated[int, Field(ge=2, le=1_000_000)]


class Square(_Part):
    name: Literal["square"]
    side_m: Length
    drive_steps: Annotated[int, Field(ge=1, le=100_000)]
    turn_steps: Annotated[int, Field(ge=1, le=100_000)]
    first_steps: Annotated[int, Field(ge=0)]


Motion = Annotated[Rotation | Square, Field(discriminator="name")]


class Drifting(_Part):
    name: Literal["drift"]
    speed_m_s: SpeedRange
    turn_steps: StepsRange


class Population(_Part):
    count: NumberRange
    radius_m: LengthRange
    aspect: RatioRange
    disc_share: Annotated[float, Field(ge=0, le=1)]
    behavior: Drifting | None = None


class Experiment(_Part):
    motion: Motion
    obstacles: Population
    clear_radius_m: Annotated[float, Field(ge=0, le=10_000, allow_inf_nan=False)]


class Worlds(_Part):
    """The complete content of conf/world."""

    world: World
    robot: Robot
    motions: dict[Name, Motion]
    obstacles: dict[Name, Population]
    experiments: dict[Name, Experiment]


def world_errors(world: dict[str, Any]) -> list[ConfigError]:
    """Return all config errors of `world`: first of single values, then of their combinations.

    Args:
        world: the section `world` of the configuration, as plain values.

    Returns:
        the config errors; empty if the worlds of every experiment can be recorded.
    """
    numbers = [key for key in world.get("experiments") or {} if not isinstance(key, str)]
    if numbers:
        quoted = ", ".join(f'"{key}"' for key in numbers)
        return [
            ConfigError("world.experiments", numbers, f"names of experiments are strings: write {quoted} in the YAML")
        ]
    try:
        Worlds.model_validate_json(json.dumps(world))  # JSON, for strict types and lists where the schema has tuples
    except ValidationError as error:
        return _once(config_errors_of(error, "world."))
    errors = []
    for name, experiment in world["experiments"].items():
        spec = {"experiment": name, "world": world["world"], "robot": world["robot"], **experiment}
        message = _error_of_spec(spec)
        if message:
            errors.append(ConfigError(f"world.experiments.{name}", None, message))
    return errors


def _once(errors: list[ConfigError]) -> list[ConfigError]:
    """Report an error once, not in every experiment that refers to the value; drop pydantic's union tags."""
    tag = re.compile(r"(\.motions?(?:\.[\w-]+)??)\.(?:rotate|square)(?=\.\w+$)")
    plain = [ConfigError(tag.sub(r"\1", error.key), error.value, error.expected) for error in errors]
    named = {(e.key.split(".")[-1], str(e.value)) for e in plain if not e.key.startswith("world.experiments.")}
    return [
        error
        for error in plain
        if not error.key.startswith("world.experiments.") or (error.key.split(".")[-1], str(error.value)) not in named
    ]


def _error_of_spec(spec: dict[str, Any]) -> str | None:
    """Return an error in the combination of the values of an experiment; None without one."""
    step_time, behavior = spec["world"]["step_time"], spec["obstacles"].get("behavior")
    beams = spec["robot"]["sensors"][0]["number"]
    try:
        commands = robot_commands({**spec["motion"], "direction": 1}, step_time)
        if len(commands) * beams > MAX_READINGS:
            return f"{len(commands)} steps of {beams} beams are more than {MAX_READINGS} readings: use fewer"
        check_spec(spec)
        if behavior and behavior["speed_m_s"][1] * step_time * len(commands) > spec["world"]["width"]:
            speed = behavior["speed_m_s"][1]
            return f"obstacles of {speed} m/s would cross the whole map in a recording: make them slower"
        fastest = np.abs(commands).max(axis=0)
        if (fastest > spec["robot"]["vel_max"]).any() or (-fastest < spec["robot"]["vel_min"]).any():
            limits = f"vel_min {spec['robot']['vel_min']}, vel_max {spec['robot']['vel_max']}"
            return f"the robot needs {fastest.round(3).tolist()} m/s, rad/s both ways, beyond its {limits}"
        sample_world(spec, 0)
    except ValueError as error:
        return str(error)
    return None
