"""Parts of the schema of conf/world: shapes, the robot and its motions, populations of obstacles."""

import itertools
import math
from typing import Annotated, Any, Literal

import shapely
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from repro.fields import STRICT, ordered
from repro.system.errors import InputError


def _amount(value: Any) -> str:
    return "<several>" if isinstance(value, list) else "<one>"


# Ranges in which IR-SIM, the recorder and float32 compute what the value says
Length = Annotated[float, Field(ge=0.01, le=10_000, allow_inf_nan=False)]  # [m]
LengthRange = Annotated[tuple[Length, Length], AfterValidator(ordered)]
Duration = Annotated[float, Field(ge=1e-4, le=1000, allow_inf_nan=False)]  # [s]
Speed = Annotated[float, Field(ge=1e-6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
SpeedRange = Annotated[tuple[Speed, Speed], AfterValidator(ordered)]
SpeedOrRange = Annotated[
    Annotated[Speed, Tag("<one>")] | Annotated[SpeedRange, Tag("<several>")], Discriminator(_amount)
]
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi, allow_inf_nan=False)]  # [rad]
AngleRange = Annotated[tuple[Angle, Angle], AfterValidator(ordered)]
AngleOrRange = Annotated[
    Annotated[Angle, Tag("<one>")] | Annotated[AngleRange, Tag("<several>")], Discriminator(_amount)
]
Limit = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]  # [m/s] or [rad/s]
Ratio = Annotated[float, Field(ge=0.01, le=100, allow_inf_nan=False)]
RatioRange = Annotated[tuple[Ratio, Ratio], AfterValidator(ordered)]
Steps = Annotated[int, Field(ge=1, le=1_000_000)]
StepsRange = Annotated[tuple[Steps, Steps], AfterValidator(ordered)]
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]  # [m]
Point = tuple[Coordinate, Coordinate]
Number = Annotated[int, Field(ge=1, le=1000)]
NumberRange = Annotated[tuple[Number, Number], AfterValidator(ordered)]
MAX_VERTICES, MAX_FIXED = 100, 1000  # of a polygon or line string, of the fixed obstacles of a floor


class Part(BaseModel):
    model_config = ConfigDict(**STRICT, frozen=True)


class World(Part):
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


class Rooms(Part):
    """Walls with doors and corridors that are sampled for every world."""

    side_m: LengthRange
    door_m: LengthRange
    corridor_m: LengthRange
    corridor_share: Annotated[float, Field(ge=0, le=1)]

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
    name: Literal["rotate"]
    steps: Annotated[int, Field(ge=2, le=1_000_000)]
    turned_rad: AngleOrRange = 0.0


class Square(Part):
    name: Literal["square"]
    side_m: Length
    drive_steps: Annotated[int, Field(ge=1, le=100_000)]
    turn_steps: Annotated[int, Field(ge=1, le=100_000)]
    first_steps: Annotated[int, Field(ge=0)]
    turned_rad: AngleOrRange = 0.0


class Waypoints(Part):
    """Straight drives along given points, with turns in place."""

    name: Literal["waypoints"]
    points_m: Annotated[list[Point], Field(min_length=2, max_length=1000), AfterValidator(_distinct)]
    speed_m_s: Speed
    turn_rad_s: Speed
    steps: Annotated[int, Field(ge=2, le=1_000_000)]


class RandomGoals(Part):
    """Straight drives to random goals, with turns in place; a range of speeds is sampled once per world."""

    name: Literal["random_goals"]
    speed_m_s: SpeedOrRange
    turn_rad_s: SpeedOrRange
    steps: Annotated[int, Field(ge=2, le=1_000_000)]


Motion = Annotated[Rotation | Square | Waypoints | RandomGoals, Field(discriminator="name")]


class Drifting(Part):
    name: Literal["drift"]
    speed_m_s: SpeedRange
    turn_steps: StepsRange


Behavior = Drifting  # or a union of behaviors by their names


class Sized(Part):
    """Discs and rectangles of random size."""

    count: NumberRange
    radius_m: LengthRange
    aspect: RatioRange
    disc_share: Annotated[float, Field(ge=0, le=1)]
    behavior: Behavior | None = None


class Shaped(Part):
    """Obstacles of given shapes, each with the same probability."""

    count: NumberRange
    shapes: Annotated[list[AnyShape], Field(min_length=1, max_length=100)]
    behavior: Behavior | None = None


def _kind(value: Any) -> str:
    return "<shaped>" if isinstance(value, dict) and "shapes" in value else "<sized>"


Population = Annotated[Annotated[Sized, Tag("<sized>")] | Annotated[Shaped, Tag("<shaped>")], Discriminator(_kind)]
Populations = Annotated[
    Annotated[Population, Tag("<one>")] | Annotated[list[Population], Field(max_length=100), Tag("<several>")],
    Discriminator(_amount),
]
