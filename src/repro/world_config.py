"""What decides the worlds of an experiment: the typed content of the files of conf/world; docs/worlds.md lists it.

Unknown keys are refused, because IR-SIM would apply them and the recorder would ignore them.
"""

import copy
import itertools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import shapely
from omegaconf import DictConfig, OmegaConf
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError, model_validator

from repro.fields import STRICT, NotNegative, config_errors_of, ordered
from repro.system.errors import InputError

T = TypeVar("T")


def _amount(value: Any) -> str:
    return "<several>" if isinstance(value, list | tuple) else "<one>"


Range = Annotated[tuple[T, T], AfterValidator(ordered)]
OneOrRange = Annotated[Annotated[T, Tag("<one>")] | Annotated[Range[T], Tag("<several>")], Discriminator(_amount)]
# Limits within which IR-SIM, the recorder and float32 compute what the value says
Length = Annotated[float, Field(ge=0.01, le=10_000, allow_inf_nan=False)]  # [m]
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]  # [m]
Point = tuple[Coordinate, Coordinate]
Duration = Annotated[float, Field(ge=1e-4, le=1000, allow_inf_nan=False)]  # [s]
Speed = Annotated[float, Field(ge=1e-6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
Limit = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi, allow_inf_nan=False)]  # [rad]
Ratio = Annotated[float, Field(ge=0.01, le=100, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]
Steps = Annotated[int, Field(ge=1, le=1_000_000)]
WindowSteps = Annotated[int, Field(ge=2, le=1_000_000)]  # steps
Number = Annotated[int, Field(ge=1, le=1000)]
MAX_VERTICES, MAX_FIXED = 100, 1000  # of a polygon or line string, of the fixed obstacles of a floor


class Part(BaseModel):
    model_config = ConfigDict(**STRICT, frozen=True)

    def irsim(self) -> dict[str, Any]:
        """Return the part as IR-SIM reads it, with the keys that were given."""
        return self.model_dump(mode="json", exclude_unset=True)


class Map(Part):
    """The map; obstacles may pass through one another, as they do in the recorder."""

    width: Length
    height: Length
    step_time: Duration
    collision_mode: Literal["unobstructed"]


class Lidar(Part):
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
    def _is_complete(self) -> "Lidar":
        if self.angle_range / (self.number - 1) >= math.pi:
            raise InputError("the beams must be less than half a turn apart: use more")
        if self.noise and self.std is None:
            raise InputError("noise: true needs std, the standard deviation of the ranges [m]")
        if not self.noise and (self.std is not None or self.angle_std is not None):
            raise InputError("std and angle_std need noise: true")
        return self


class Kinematics(Part):
    name: Literal["diff"]


class Disc(Part):
    name: Literal["circle"]
    radius: Length


class Rectangle(Part):
    name: Literal["rectangle"]
    length: Length
    width: Length


def _simple(vertices: list[Point]) -> list[Point]:
    """Check that a polygon neither crosses itself nor vanishes; IR-SIM would draw its bounding box instead."""
    polygon = shapely.Polygon(vertices)
    if not polygon.is_valid:
        raise InputError(f"must be a polygon that does not cross or touch itself: {shapely.is_valid_reason(polygon)}")
    if polygon.area < max(1e-4, 1e-6 * polygon.length**2):
        raise InputError("must be a polygon with an area: use a linestring for a thin wall")
    return vertices


def _distinct(points: list[Point]) -> list[Point]:
    if any(a == b for a, b in itertools.pairwise(points)):
        raise InputError("must not name the same point twice in a row")
    return points


class Polygon(Part):
    """A polygon, convex or not."""

    name: Literal["polygon"]
    vertices: Annotated[list[Point], Field(min_length=3, max_length=MAX_VERTICES), AfterValidator(_simple)]


class LineString(Part):
    """A wall without width."""

    name: Literal["linestring"]
    vertices: Annotated[list[Point], Field(min_length=2, max_length=MAX_VERTICES), AfterValidator(_distinct)]


AnyShape = Annotated[Disc | Rectangle | Polygon | LineString, Field(discriminator="name")]


class Fixed(Part):
    """An obstacle that stands in every world, at x, y [m], heading [rad]."""

    shape: AnyShape
    state: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)


FixedList = Annotated[list[Fixed], Field(max_length=MAX_FIXED)]


class Cabinets(Part):
    """Boxes against the walls; `per_m` is drawn for each wall, and is their number per meter of a side of it."""

    per_m: Range[Probability]
    length_m: Range[Length]
    depth_m: Range[Length]


class Rooms(Part):
    """Walls with doors and corridors that are sampled for every world.

    Args:
        side_m: sides of rooms [m].
        door_m: widths of doors [m].
        corridor_m: widths of corridors [m].
        corridor_share: probability that a corridor takes the place of a wall.
        longest_m: the longest side of the rooms of a world, drawn for each world in place of the second of `side_m`.
        thickness_m: thickness of the walls of a world, drawn for each world [m]; None is no thickness.
        closed_share: probability that a door is closed.
        leaf_share: probability that an open door has a leaf, at any angle of up to 120 degrees from its wall.
        cabinets: boxes against the walls.
    """

    side_m: Range[Length]
    door_m: Range[Length]
    corridor_m: Range[Length]
    corridor_share: Probability
    longest_m: Range[Length] | None = None
    thickness_m: Range[Length] | None = None
    closed_share: Probability = 0.0
    leaf_share: Probability = 0.0
    cabinets: Cabinets | None = None

    @model_validator(mode="after")
    def _has_doors(self) -> "Rooms":
        if self.door_m[1] > self.side_m[0]:
            raise InputError(f"doors of {self.door_m[1]:g} m are wider than the shortest side of {self.side_m[0]:g} m")
        return self


class Robot(Part):
    """A disc-shaped differential-drive robot with one lidar; its start pose follows from the motion."""

    kinematics: Kinematics
    shape: Disc
    vel_min: tuple[Limit, Limit]
    vel_max: tuple[Speed, Speed]
    sensors: Annotated[list[Lidar], Field(min_length=1, max_length=1)]


class Rotation(Part):
    """A full turn in place; `turned_rad` [rad] is its start heading, or the range of it."""

    name: Literal["rotate"]
    steps: WindowSteps
    turned_rad: OneOrRange[Angle] = 0.0


class Square(Part):
    """A square, turned about the center of the map by `turned_rad` [rad], or by an angle in that range."""

    name: Literal["square"]
    side_m: Length
    drive_steps: Annotated[int, Field(ge=1, le=100_000)]
    turn_steps: Annotated[int, Field(ge=1, le=100_000)]
    first_steps: Annotated[int, Field(ge=0)]
    turned_rad: OneOrRange[Angle] = 0.0

    @property
    def steps(self) -> int:
        return 4 * (self.drive_steps + self.turn_steps)


class Waypoints(Part):
    """Straight drives along given points, with turns in place."""

    name: Literal["waypoints"]
    points_m: Annotated[list[Point], Field(min_length=2, max_length=1000), AfterValidator(_distinct)]
    speed_m_s: Speed
    turn_rad_s: Speed
    steps: WindowSteps


class Standing(Part):
    """A robot that stands, at any place and heading, and swings its view by `swing_rad` [rad] in `period_s` [s]."""

    share: Probability
    swing_rad: Range[Annotated[float, Field(ge=0, le=math.pi, allow_inf_nan=False)]]
    period_s: Range[Duration]

    @property
    def turn_rad_s(self) -> float:
        """The largest rate of turn [rad/s]."""
        return 2 * math.pi * self.swing_rad[1] / self.period_s[0]


class RandomGoals(Part):
    """Straight drives to random goals, with turns in place; a range of speeds is sampled once per world.

    In a part of the worlds, the robot stands. It keeps `margin_m` from the border of the map [m], at least its radius.
    """

    name: Literal["random_goals"]
    speed_m_s: OneOrRange[Speed]
    turn_rad_s: OneOrRange[Speed]
    steps: WindowSteps
    margin_m: Length | None = None
    standing: Standing | None = None


Motion = Annotated[Rotation | Square | Waypoints | RandomGoals, Field(discriminator="name")]


class Drifting(Part):
    name: Literal["drift"]
    speed_m_s: Range[Speed]
    turn_steps: Range[Steps]


class Walking(Part):
    """Straight ways of `way_steps`, after which a person stops (`stop_share`, `stop_steps`) or turns (`turn_rad`)."""

    name: Literal["walk"]
    speed_m_s: Range[Speed]
    way_steps: Range[Steps]
    turn_rad: Annotated[float, Field(ge=0, le=math.pi, allow_inf_nan=False)]
    stop_share: Probability
    stop_steps: Range[Steps]


Behavior = Annotated[Drifting | Walking, Field(discriminator="name")]


class Sized(Part):
    """Discs and rectangles of random size."""

    count: Range[Number]
    radius_m: Range[Length]
    aspect: Range[Ratio]
    disc_share: Probability
    behavior: Behavior | None = None


class Shaped(Part):
    """Obstacles of given shapes, each with the same probability."""

    count: Range[Number]
    shapes: Annotated[list[AnyShape], Field(min_length=1, max_length=100)]
    behavior: Behavior | None = None


def _kind(value: Any) -> str:
    return "<shaped>" if isinstance(value, dict) and "shapes" in value else "<sized>"


Population = Annotated[Annotated[Sized, Tag("<sized>")] | Annotated[Shaped, Tag("<shaped>")], Discriminator(_kind)]
Populations = Annotated[
    Annotated[Population, Tag("<one>")] | Annotated[list[Population], Field(max_length=100), Tag("<several>")],
    Discriminator(_amount),
]


class Sensing(Part):
    """What a real lidar and odometry do to the scans of a recording; each value is drawn once per recording.

    Args:
        range_m: beyond this range a beam has no reading [m].
        noise_m: standard deviation of the noise of ranges, beside that of the lidar [m].
        lost_share: share of the beams without a reading.
        every_beam: only every n-th beam has readings.
        every_step: a new scan comes every n-th step; the steps between repeat it.
        odometry: standard deviation of the scale errors of distances and turns.
        pose_m: standard deviation of independent errors of all poses but the newest [m], see `sensing.noisy_poses`.
    """

    range_m: Range[Length]
    noise_m: Range[NotNegative]
    lost_share: Range[Probability]
    every_beam: Range[Annotated[int, Field(ge=1, le=100)]]
    every_step: Range[Steps]
    odometry: Range[Probability]
    pose_m: Range[NotNegative]


class Experiment(Part):
    """A motion of the robot and the obstacles around it."""

    motion: Motion
    obstacles: Populations
    clear_radius_m: Annotated[float, Field(ge=0, le=10_000, allow_inf_nan=False)]
    fixed: FixedList = Field(default_factory=list)
    rooms: Rooms | None = None
    sensing: Sensing | None = None

    @model_validator(mode="after")
    def _has_obstacles(self) -> "Experiment":
        if not self.fixed and not self.rooms and self.obstacles == []:
            raise InputError("has no obstacles: name a population in obstacles, fixed obstacles, or rooms")
        return self

    @property
    def populations(self) -> list[Sized | Shaped]:
        """The populations of obstacles, of which a file may name one or a list."""
        return self.obstacles if isinstance(self.obstacles, list) else [self.obstacles]

    @property
    def is_drive(self) -> bool:
        """Whether the robot drives through the map, and the clear zone with it, rather than in a zone at the center."""
        return isinstance(self.motion, Waypoints | RandomGoals)

    @property
    def behaviors(self) -> list[Behavior]:
        """The motions of the populations that move."""
        return [population.behavior for population in self.populations if population.behavior]


class WorldSpec(Experiment):
    """What decides the worlds of an experiment, as `simulation.worlds.sample_world` takes it.

    Args:
        experiment: its name.
        world: the map.
        robot: the robot.
        raw: the content that was parsed, with its numbers as they were written, which `format.spec_fingerprint` hashes.
    """

    experiment: str
    world: Map
    robot: Robot
    raw: dict[str, Any]

    @classmethod
    def parse(cls, raw: Mapping[str, Any]) -> "WorldSpec":
        """Check `experiment`, `world`, `robot` and the keys of the experiment.

        Raises:
            ValueError: a key is unknown or missing, or a value is of another type or out of range.
        """
        try:
            return cls.model_validate_json(json.dumps({**raw, "raw": raw}))  # JSON, for strict types and tuples
        except ValidationError as error:
            raise InputError("; ".join(str(each) for each in config_errors_of(error))) from error

    @property
    def lidar(self) -> Lidar:
        return self.robot.sensors[0]

    @property
    def is_like_papers(self) -> bool:
        """Whether one population of discs and rectangles stands or drifts around a rotating robot or its square.

        There are neither fixed obstacles nor errors of the sensors.
        """
        drifts = all(behavior.name == "drift" for behavior in self.behaviors)
        differs = self.is_drive or self.fixed or self.lidar.noise or self.sensing
        return isinstance(self.obstacles, Sized) and drifts and not differs

    @property
    def steps(self) -> int:
        """Time steps of a recording, T."""
        return self.motion.steps

    def with_lidar(self, **values: Any) -> "WorldSpec":
        """Return the spec with other values of the lidar, by their names in conf/world.

        Raises:
            ValueError: see `parse`.
        """
        raw = copy.deepcopy(self.raw)
        raw["robot"]["sensors"][0].update(values)
        return WorldSpec.parse(raw)


def plain(config: DictConfig) -> dict[str, Any]:
    """Return a part of the configuration as plain values, its interpolations resolved."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def read_world(path: Path) -> dict[str, Any]:
    """Load a file of conf/world with those in its defaults, interpolations resolved as in the whole configuration."""
    return plain(OmegaConf.create({"world": _merged(path)}))["world"]


def _merged(path: Path) -> DictConfig:
    """Return a file merged with the files beside it that its defaults name, in their order, as Hydra merges them."""
    content = OmegaConf.load(path)
    assert isinstance(content, DictConfig), f"{path} is not a mapping"
    names = content.pop("defaults", ["_self_"])
    parts = [content if name == "_self_" else _merged(path.with_name(f"{name}.yaml")) for name in names]
    return OmegaConf.merge(*parts)  # type: ignore[return-value]


def world_spec(world: Mapping[str, Any], experiment: str) -> WorldSpec:
    """Return what decides the worlds of an experiment of a file of conf/world.

    Raises:
        ValueError: see `WorldSpec.parse`.
    """
    parts = {"experiment": experiment, "world": world["world"], "robot": world["robot"]}
    return WorldSpec.parse({**parts, **world["experiments"][experiment]})


def is_moving(experiment: Mapping[str, Any]) -> bool:
    """Return whether any obstacles of an experiment of a file of conf/world move."""
    obstacles = experiment["obstacles"]
    return any(each.get("behavior") for each in (obstacles if isinstance(obstacles, list) else [obstacles]))
