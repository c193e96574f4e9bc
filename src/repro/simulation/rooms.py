"""Rooms: walls with doors and corridors that are sampled for every world, as a part of a larger floor.

A rectangle that covers the map at any heading is divided again and again across its longer side, by a wall or by a
corridor between two walls, until its parts have the size of rooms. Every wall has doors, so all rooms are connected
unless doors are closed. Walls, door leaves and cabinets are line strings, closed ones where they have a thickness: a
polygon thinner than a pixel would have gaps on the true map.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely

from repro.simulation.shapes import Obstacle, standing
from repro.system.errors import InputError
from repro.worlds.obstacles import Cabinets, Rooms
from repro.worlds.robot_motions import Motion, RandomGoals
from repro.worlds.walls import line_strings

_PLACES = 20  # attempts to place a wall that ends at no door
_BESIDE_M = 0.1  # least distance between a door and the end of another wall [m]
_MOST = 1000  # rooms of a floor
_Points = list[list[float]]  # x, y [m]
_WIDEST_RAD = math.radians(120)  # between the leaf of a door and its wall


def check_rooms(rooms: Rooms, motion: Motion, width_m: float, robot_m: float) -> None:
    """Check that a robot finds its way through rooms, and that they can be sampled in a second.

    Args:
        rooms: their sizes.
        motion: the robot's motion.
        width_m: side of the square map [m].
        robot_m: diameter of the robot [m].

    Raises:
        InputError: the robot drives through walls or fits through no door, or there are too many rooms.
    """
    if not isinstance(motion, RandomGoals):
        raise InputError(f"rooms need the motion random_goals, which avoids their walls, got {motion.name}")
    for name, (least, _) in (("door_m", rooms.door_m), ("corridor_m", rooms.corridor_m)):
        if least <= robot_m:
            raise InputError(f"rooms.{name} begins at {least:g} m: expected more than the robot's {robot_m:g} m")
    count = 2 * (width_m / float(np.mean(rooms.side_m))) ** 2
    if count > _MOST:
        raise InputError(
            f"a map of {width_m:g} m has about {count:.0f} rooms with sides of {list(rooms.side_m)} m, at most {_MOST} "
            "are allowed: use longer sides or a smaller map"
        )


def sample_rooms(rng: np.random.Generator, rooms: Rooms, width_m: float) -> list[Obstacle]:
    """Sample the walls of one world.

    Args:
        rooms: their sizes [m], and the probability that a rectangle is divided by a corridor; see docs/worlds.md.
        width_m: side of the square map [m].

    Returns:
        the walls that are on the map, each piece between two doors as a standing obstacle, a line string, then door
        leaves and cabinets.
    """
    if rooms.longest_m:
        longest = float(rng.uniform(*rooms.longest_m))
        rooms = rooms.model_copy(update={"side_m": (rooms.side_m[0], max(longest, rooms.side_m[0]))})
    floor = _Floor(rng, rooms)
    half = width_m / math.sqrt(2)  # of the diagonal
    floor.divide((-half, -half), (half, half))
    heading = rng.uniform(-math.pi, math.pi)
    turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    pieces = [np.array(piece) @ turn + width_m / 2 for piece in _outlines(floor)]
    on_map = shapely.intersects(line_strings(pieces), shapely.box(0, 0, width_m, width_m)) if pieces else []
    return [
        standing({"name": "linestring", "vertices": piece.tolist()})
        for piece, is_on_map in zip(pieces, on_map, strict=True)
        if is_on_map
    ]


def _outlines(floor: "_Floor") -> list[_Points]:
    """Return the pieces of all walls, then door leaves and cabinets, as lines."""
    rng, rooms = floor.rng, floor.rooms
    thickness = float(rng.uniform(*rooms.thickness_m)) if rooms.thickness_m else 0.0
    lines, beside = [], []
    for wall in floor.walls:
        lines += [
            _box(wall, *ends, (-thickness / 2, thickness / 2)) if thickness else wall.piece(*ends)
            for ends in wall.spans()
        ]
        beside += _leaves(rng, rooms, wall)
        if rooms.cabinets:
            beside += _cabinets(rng, rooms.cabinets, wall, thickness / 2)
    return [*lines, *beside]


def _box(wall: "_Wall", low: float, high: float, across: tuple[float, float]) -> _Points:
    """Return the outline of a box from `low` to `high` along a wall and from the first to the last of `across` it."""
    corners = [(low, 0), (high, 0), (high, 1), (low, 1), (low, 0)]
    return [wall.point(along, across[side]) for along, side in corners]


def _leaves(rng: np.random.Generator, rooms: Rooms, wall: "_Wall") -> list[_Points]:
    """Draw the leaves of the doors of a wall: closed ones fill the door."""
    lines = []
    for low, high in wall.doors:
        if rooms.closed_share and rng.random() < rooms.closed_share:
            lines.append(wall.piece(low, high))
        elif rooms.leaf_share and rng.random() < rooms.leaf_share:
            angle, side, is_low = rng.uniform(0, _WIDEST_RAD), rng.choice([-1.0, 1.0]), rng.random() < 0.5
            hinge, inward = (low, 1.0) if is_low else (high, -1.0)
            width = high - low
            end = wall.point(hinge + inward * width * math.cos(angle), side * width * math.sin(angle))
            lines.append([wall.point(hinge, 0.0), end])
    return lines


def _cabinets(rng: np.random.Generator, cabinets: Cabinets, wall: "_Wall", half_m: float) -> list[_Points]:
    """Draw boxes against both sides of a wall, between its doors; they may overlap."""
    per_m, boxes = rng.uniform(*cabinets.per_m), []
    for low, high in wall.spans():
        for side in (-1.0, 1.0):
            for _ in range(rng.poisson(per_m * (high - low))):
                length, depth = rng.uniform(*cabinets.length_m), rng.uniform(*cabinets.depth_m)
                if length < high - low:
                    begin = rng.uniform(low, high - length)
                    boxes.append(_box(wall, begin, begin + length, (side * half_m, side * (half_m + depth))))
    return boxes


@dataclass(frozen=True)
class _Wall:
    """A wall from `low` to `high` along one axis, at a place on the other one [m], and its doors, in order."""

    axis: int  # across the wall
    at: float
    low: float
    high: float
    doors: list[tuple[float, float]]

    def piece(self, low: float, high: float) -> _Points:
        """Return the ends of a part of the wall."""
        return [self.point(low, 0.0), self.point(high, 0.0)]

    def spans(self) -> list[tuple[float, float]]:
        """Return where the parts between the doors begin and end, along the wall [m]."""
        ends = [self.low, *(end for door in self.doors for end in door), self.high]
        return [part for part in list(pairwise(ends))[::2] if part[1] > part[0]]

    def point(self, along: float, across: float) -> list[float]:
        """Return a point x, y at a place along the wall and at a distance from it [m]."""
        point = [self.at + across, along]
        return point if self.axis == 0 else point[::-1]


@dataclass
class _Floor:
    rng: np.random.Generator
    rooms: Rooms
    walls: list[_Wall] = field(default_factory=list)
    doors: dict[tuple[int, float], list[tuple[float, float]]] = field(default_factory=dict)  # by the line of a wall

    def divide(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        """Divide a rectangle, given its corners [m], unless it is a room."""
        shortest, longest = self.rooms.side_m
        sides = [high[axis] - low[axis] for axis in (0, 1)]
        axis = int(sides[1] > sides[0])
        if sides[axis] <= self.rng.uniform(shortest, longest):
            return
        width = 0.0
        if self.rng.random() < self.rooms.corridor_share:
            width = float(self.rng.uniform(*self.rooms.corridor_m))
        if sides[axis] < 2 * shortest + width:
            return
        other = 1 - axis
        for _ in range(_PLACES):
            at = float(self.rng.uniform(low[axis] + shortest, high[axis] - shortest - width))
            ends = (at, at + width) if width else (at,)
            if not any(self._is_at_door(other, side, end) for end in ends for side in (low[other], high[other])):
                break
        else:
            return
        for end in ends:
            wall = _Wall(axis, end, low[other], high[other], self._doors(low[other], high[other]))
            self.walls.append(wall)
            self.doors.setdefault((axis, end), []).extend(wall.doors)
        self.divide(low, _replaced(high, axis, ends[0]))
        self.divide(_replaced(low, axis, ends[-1]), high)

    def _is_at_door(self, axis: int, at: float, place: float) -> bool:
        """Check whether a wall that ends at a place of another wall would end in one of its doors, or next to it."""
        doors = self.doors.get((axis, at), [])
        return any(begin - _BESIDE_M <= place <= end + _BESIDE_M for begin, end in doors)

    def _doors(self, low: float, high: float) -> list[tuple[float, float]]:
        """Draw the doors of a wall: one in each of its equal parts, which are about as long as the longest room."""
        parts = max(1, round((high - low) / self.rooms.side_m[1]))
        length = (high - low) / parts
        doors = []
        for part in range(parts):
            width = min(float(self.rng.uniform(*self.rooms.door_m)), length)
            begin = low + part * length + float(self.rng.uniform(0, length - width))
            doors.append((begin, begin + width))
        return doors


def _replaced(corner: tuple[float, float], axis: int, value: float) -> tuple[float, float]:
    return (value, corner[1]) if axis == 0 else (corner[0], value)
