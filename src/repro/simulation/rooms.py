"""Rooms: walls with doors and corridors that are sampled for every world, as a part of a larger floor.

A rectangle that covers the map at any heading is divided again and again across its longer side, by a wall or by a
corridor between two walls, until its parts have the size of rooms. Every wall has doors, so all rooms are connected.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely

from repro.simulation.shapes import Obstacle, standing
from repro.system.errors import InputError
from repro.world_config import Motion, RandomGoals, Rooms

_PLACES = 20  # attempts to place a wall that ends at no door
_BESIDE_M = 0.1  # least distance between a door and the end of another wall [m]
_MOST = 1000  # rooms of a floor


def check_rooms(rooms: Rooms, motion: Motion, width_m: float, robot_m: float) -> None:
    """Check that a robot finds its way through rooms, and that they can be sampled in a second.

    Args:
        rooms: their sizes.
        motion: the robot's motion.
        width_m: side of the square map [m].
        robot_m: diameter of the robot [m].

    Raises:
        ValueError: the robot drives through walls or fits through no door, or there are too many rooms.
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
        rng: random stream of the world.
        rooms: their sizes [m], and the probability that a rectangle is divided by a corridor; see docs/worlds.md.
        width_m: side of the square map [m].

    Returns:
        the walls that are on the map, each piece between two doors as a standing obstacle, a line string.
    """
    floor = _Floor(rng, rooms)
    half = width_m / math.sqrt(2)  # of the diagonal
    floor.divide((-half, -half), (half, half))
    heading = rng.uniform(-math.pi, math.pi)
    turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    pieces = [np.array(piece) @ turn + width_m / 2 for wall in floor.walls for piece in wall.pieces()]
    on_map = shapely.intersects(shapely.linestrings(pieces), shapely.box(0, 0, width_m, width_m)) if pieces else []
    return [
        standing({"name": "linestring", "vertices": piece.tolist()})
        for piece, is_on_map in zip(pieces, on_map, strict=True)
        if is_on_map
    ]


@dataclass(frozen=True)
class _Wall:
    """A wall from `low` to `high` along one axis, at a place on the other one [m], and its doors, in order."""

    axis: int  # across the wall
    at: float
    low: float
    high: float
    doors: list[tuple[float, float]]

    def pieces(self) -> list[list[list[float]]]:
        """Return the parts between the doors as pairs of points x, y [m]."""
        ends = [self.low, *(end for door in self.doors for end in door), self.high]
        parts = list(pairwise(ends))[::2]
        points = [[[self.at, along] for along in part] for part in parts if part[1] > part[0]]
        return points if self.axis == 0 else [[point[::-1] for point in piece] for piece in points]


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
