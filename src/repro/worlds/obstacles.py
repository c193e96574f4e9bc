"""Obstacles in a file of conf/world: their shapes, fixed ones, rooms, and populations."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from repro.system.errors import InputError
from repro.worlds.limits import (
    Coordinate,
    Length,
    Number,
    OneOrList,
    Point,
    Probability,
    Range,
    Ratio,
    Section,
    distinct,
)
from repro.worlds.obstacle_motions import Behavior

MAX_VERTICES, MAX_FIXED = 100, 1000  # of a polygon or line string, of the fixed obstacles of a floor


class Disc(Section):
    name: Literal["circle"]
    radius: Length


class Rectangle(Section):
    name: Literal["rectangle"]
    length: Length
    width: Length


def _simple(vertices: list[Point]) -> list[Point]:
    """Check that a polygon neither crosses itself nor vanishes; IR-SIM would draw its bounding box instead."""
    import shapely  # which reading a world without polygons does not need

    polygon = shapely.Polygon(vertices)
    if not polygon.is_valid:
        raise InputError(f"must be a polygon that does not cross or touch itself: {shapely.is_valid_reason(polygon)}")
    if polygon.area < max(1e-4, 1e-6 * polygon.length**2):
        raise InputError("must be a polygon with an area: use a linestring for a thin wall")
    return vertices


class Polygon(Section):
    """A polygon, convex or not."""

    name: Literal["polygon"]
    vertices: Annotated[
        list[Point],
        Field(min_length=3, max_length=MAX_VERTICES),
        AfterValidator(distinct),  # at a corner that is named twice, IR-SIM's lidar hits nothing that is there
        AfterValidator(_simple),
    ]


class LineString(Section):
    """A wall without width."""

    name: Literal["linestring"]
    vertices: Annotated[list[Point], Field(min_length=2, max_length=MAX_VERTICES), AfterValidator(distinct)]


AnyShape = Annotated[Disc | Rectangle | Polygon | LineString, Field(discriminator="name")]


class Fixed(Section):
    """An obstacle that stands in every world, at x, y [m], heading [rad]."""

    shape: AnyShape
    state: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)


FixedList = Annotated[list[Fixed], Field(max_length=MAX_FIXED)]


class Cabinets(Section):
    """Boxes against the walls; `per_m` is drawn for each wall, and is their number per meter of a side of it."""

    per_m: Range[Probability]
    length_m: Range[Length]
    depth_m: Range[Length]


class Rooms(Section):
    """Walls with doors and corridors that are sampled for every world, see `simulation.rooms`.

    `longest_m` and `thickness_m` are drawn once per world.
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


class Sized(Section):
    """Discs and rectangles of random size."""

    count: Range[Number]
    radius_m: Range[Length]
    aspect: Range[Ratio]
    disc_share: Probability
    behavior: Behavior | None = None


class Shaped(Section):
    """Obstacles of given shapes, each with the same probability."""

    count: Range[Number]
    shapes: Annotated[list[AnyShape], Field(min_length=1, max_length=100)]
    behavior: Behavior | None = None


def _kind(value: Any) -> str:
    return "<shaped>" if isinstance(value, dict) and "shapes" in value else "<sized>"


Population = Annotated[Annotated[Sized, Tag("<sized>")] | Annotated[Shaped, Tag("<shaped>")], Discriminator(_kind)]
Populations = OneOrList[Population]
