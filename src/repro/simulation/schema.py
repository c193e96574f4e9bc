"""Schema of conf/world: the allowed keys and the range of every value; docs/worlds.md lists them.

The models mirror the files of conf/world. Unknown keys are rejected by name, because IR-SIM would apply them and the
recorder would ignore them.
"""

import itertools
import json
import math
import re
from typing import Annotated, Any, Literal

import shapely
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError, model_validator

from repro.config import ConfigError, config_errors_of, populations
from repro.simulation.motions import recorded_steps, top_speeds
from repro.simulation.shapes import geometry
from repro.simulation.worlds import check_spec, fixed_obstacles, sample_world


def _ordered(pair: tuple) -> tuple:
    if pair[0] > pair[1]:
        raise ValueError("must be ordered, low to high")
    return pair


MAX_STEPS = 30_000  # of a recording; ages of pixels are stored in 16 bits
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
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]  # [m]
Point = tuple[Coordinate, Coordinate]
Number = Annotated[int, Field(ge=1, le=1000)]
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
    """IR-SIM's lidar at the center of the robot, with normal noise of the ranges [m] and of the beams' angles [rad]."""

    type: Literal["lidar2d"]
    range_min: Literal[0] = 0
    range_max: Length
    angle_range: Annotated[float, Field(ge=0.001, le=2 * math.pi, allow_inf_nan=False)]
    number: Annotated[int, Field(ge=2, le=100_000)]
    noise: bool = False
    std: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] | None = None
    angle_std: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = None

    @model_validator(mode="after")
    def _noise_is_complete(self) -> "Lidar":
        if self.noise and self.std is None:
            raise ValueError("noise: true needs std, the standard deviation of the ranges [m]")
        if not self.noise and (self.std is not None or self.angle_std is not None):
            raise ValueError("std and angle_std need noise: true")
        return self


class Kinematics(_Part):
    name: Literal["diff"]


class Disc(_Part):
    name: Literal["circle"]
    radius: Length


class Rectangle(_Part):
    name: Literal["rectangle"]
    length: Length
    width: Length


def _simple(vertices: list[Point]) -> list[Point]:
    """Check that a polygon neither crosses itself nor vanishes; IR-SIM would draw its bounding box instead."""
    polygon = shapely.Polygon(vertices)
    if not polygon.is_valid:
        raise ValueError(f"must be a polygon that does not cross or touch itself: {shapely.is_valid_reason(polygon)}")
    if polygon.area < max(1e-4, 1e-6 * polygon.length**2):
        raise ValueError("must be a polygon with an area: use a linestring for a thin wall")
    return vertices


def _distinct(points: list[Point]) -> list[Point]:
    if any(a == b for a, b in itertools.pairwise(points)):
        raise ValueError("must not name the same point twice in a row")
    return points


class Polygon(_Part):
    """A polygon, convex or not."""

    name: Literal["polygon"]
    vertices: Annotated[list[Point], Field(min_length=3, max_length=100), AfterValidator(_simple)]


class LineString(_Part):
    """A wall without width."""

    name: Literal["linestring"]
    vertices: Annotated[list[Point], Field(min_length=2, max_length=100), AfterValidator(_distinct)]


AnyShape = Annotated[Disc | Rectangle | Polygon | LineString, Field(discriminator="name")]


class Fixed(_Part):
    """An obstacle that stands in every world, at x, y [m], heading [rad]."""

    shape: AnyShape
    state: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)


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


class RandomGoals(_Part):
    """Straight drives to random goals, with turns in place."""

    name: Literal["random_goals"]
    speed_m_s: Speed
    turn_rad_s: Speed
    steps: Annotated[int, Field(ge=2, le=1_000_000)]


class Waypoints(RandomGoals):
    """Straight drives along given points, with turns in place."""

    name: Literal["waypoints"]  # type: ignore[assignment]
    points_m: Annotated[list[Point], Field(min_length=2, max_length=1000), AfterValidator(_distinct)]


Motion = Annotated[Rotation | Square | Waypoints | RandomGoals, Field(discriminator="name")]


class Drifting(_Part):
    name: Literal["drift"]
    speed_m_s: SpeedRange
    turn_steps: StepsRange


class Sized(_Part):
    """Discs and rectangles of random size."""

    count: NumberRange
    radius_m: LengthRange
    aspect: RatioRange
    disc_share: Annotated[float, Field(ge=0, le=1)]
    behavior: Drifting | None = None


class Shaped(_Part):
    """Obstacles of given shapes, each with the same probability."""

    count: NumberRange
    shapes: Annotated[list[AnyShape], Field(min_length=1, max_length=100)]
    behavior: Drifting | None = None


def _kind(value: Any) -> str:
    return "<shaped>" if isinstance(value, dict) and "shapes" in value else "<sized>"


def _amount(value: Any) -> str:
    return "<several>" if isinstance(value, list) else "<one>"


Population = Annotated[Annotated[Sized, Tag("<sized>")] | Annotated[Shaped, Tag("<shaped>")], Discriminator(_kind)]
Populations = Annotated[
    Annotated[Population, Tag("<one>")] | Annotated[list[Population], Field(max_length=100), Tag("<several>")],
    Discriminator(_amount),
]


class Experiment(_Part):
    motion: Motion
    obstacles: Populations
    clear_radius_m: Annotated[float, Field(ge=0, le=10_000, allow_inf_nan=False)]
    fixed: Annotated[list[Fixed], Field(max_length=1000)] = []

    @model_validator(mode="after")
    def _has_obstacles(self) -> "Experiment":
        if not self.fixed and self.obstacles == []:
            raise ValueError("has no obstacles: name a population in obstacles, or fixed obstacles")
        return self


class Worlds(_Part):
    """The complete content of conf/world."""

    world: World
    robot: Robot
    motions: dict[Name, Motion]
    obstacles: dict[Name, Populations]
    fixed: dict[Name, Annotated[list[Fixed], Field(max_length=1000)]] = {}
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


_TAGS = (  # that pydantic adds to the path of a value in a union
    re.compile(r"()\.<\w+>"),
    re.compile(r"(\.motions?(?:\.[\w-]+)??)\.(?:rotate|square|waypoints|random_goals)(?=\.\w+(?:\.\d+)*$)"),
    re.compile(r"(\.shape|\.shapes\.\d+)\.(?:circle|rectangle|polygon|linestring)(?=\.)"),
)


def _without_tags(path: str) -> str:
    for tag in _TAGS:
        path = tag.sub(r"\1", path)
    return path


def _once(errors: list[ConfigError]) -> list[ConfigError]:
    """Report an error once, not in every experiment that refers to the value; drop pydantic's union tags."""
    plain = [ConfigError(_without_tags(error.key), error.value, error.expected) for error in errors]
    named = {(e.key.split(".")[-1], str(e.value)) for e in plain if not e.key.startswith("world.experiments.")}
    return [
        error
        for error in plain
        if not error.key.startswith("world.experiments.") or (error.key.split(".")[-1], str(error.value)) not in named
    ]


def _error_of_spec(spec: dict[str, Any]) -> str | None:
    """Return an error in the combination of the values of an experiment; None without one."""
    step_time, steps, width = spec["world"]["step_time"], recorded_steps(spec["motion"]), spec["world"]["width"]
    beams = spec["robot"]["sensors"][0]["number"]
    try:
        if steps * beams > MAX_READINGS:
            return f"{steps} steps of {beams} beams are more than {MAX_READINGS} readings: use fewer"
        if steps > MAX_STEPS:
            return f"a recording of {steps} steps is longer than {MAX_STEPS}: use fewer"
        speeds = top_speeds(spec["motion"], step_time)
        check_spec(spec)
        for number, obstacle in enumerate(fixed_obstacles(spec), start=1):
            if not geometry(obstacle["shape"], obstacle["state"]).intersects(shapely.box(0, 0, width, width)):
                return f"fixed obstacle {number} is outside the map of {width:g} x {width:g} m"
        moving = [population["behavior"] for population in populations(spec) if population.get("behavior")]
        fastest = max((behavior["speed_m_s"][1] for behavior in moving), default=0.0)
        if fastest * step_time * steps > width:
            return f"obstacles of {fastest} m/s would cross the whole map in a recording: make them slower"
        if (speeds > spec["robot"]["vel_max"]).any() or (-speeds < spec["robot"]["vel_min"]).any():
            limits = f"vel_min {spec['robot']['vel_min']}, vel_max {spec['robot']['vel_max']}"
            return f"the robot needs {speeds.round(3).tolist()} m/s, rad/s both ways, beyond its {limits}"
        sample_world(spec, 0)
    except ValueError as error:
        return str(error)
    return None
