"""Walls that moving obstacles do not touch."""

from collections.abc import Sequence

import numpy as np
import shapely

Line = list[list[float]]


class Walls:
    """Lines of points x, y [m]."""

    def __init__(self, lines: Sequence[Line]) -> None:
        self.lines = shapely.multilinestrings(line_strings(lines))

    def distance_m(self, x: float, y: float) -> float:
        """Return the distance of a point to the walls [m]."""
        return float(shapely.distance(self.lines, shapely.Point(x, y)))

    def nearest(self, x: float, y: float) -> np.ndarray:
        """Return the point of a wall that is nearest to another point, x, y [m], (2,)."""
        return shapely.get_coordinates(shapely.shortest_line(self.lines, shapely.Point(x, y)))[0]


def line_strings(lines: Sequence[Line]) -> np.ndarray:
    """Create the geometry of many lines of points x, y [m] at once, (L,)."""
    lengths = [len(line) for line in lines]
    return shapely.linestrings(
        np.concatenate([np.array(line, float) for line in lines]), indices=np.repeat(np.arange(len(lines)), lengths)
    )
