"""Shapes of obstacles with IR-SIM's names (circle, rectangle, polygon, linestring) as shapely geometry."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely

from repro.worlds.walls import Line

Shape = dict[str, Any]
Obstacle = dict[str, Any]

SNAP_M = 1e-6  # grid of the corners, where the exact union fails


def geometry(shape: Shape, state: Sequence[float] = (0.0, 0.0, 0.0)) -> shapely.Geometry:
    """Create the geometry of a shape at a state, as IR-SIM does: discs are 64-gons, line strings have no width.

    Args:
        shape: `circle` with `radius`, `rectangle` with `length` and `width`, `polygon` or `linestring` with
            `vertices` in the frame of the obstacle [m].
        state: x, y [m], heading [rad].
    """
    if shape["name"] == "circle":
        own = shapely.Point(0, 0).buffer(shape["radius"])
    elif shape["name"] == "rectangle":
        x, y = shape["length"] / 2, shape["width"] / 2
        own = shapely.box(-x, -y, x, y)
    else:
        own = (shapely.Polygon if shape["name"] == "polygon" else shapely.LineString)(shape["vertices"])
    x, y, heading = state
    turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    return shapely.transform(own, lambda points: points @ turn + [x, y])


def standing(shape: Shape, state: Sequence[float] = (0.0, 0.0, 0.0)) -> Obstacle:
    """Return an obstacle that does not move, as IR-SIM reads it."""
    return {"shape": shape, "state": list(state), "kinematics": {"name": "static"}}


def shape_radius(shape: Shape) -> float:
    """Compute the radius of the circle around the origin of a shape that encloses it [m]."""
    if shape["name"] == "circle":
        return float(shape["radius"])
    if shape["name"] == "rectangle":
        return math.hypot(shape["length"], shape["width"]) / 2
    return max(math.hypot(x, y) for x, y in shape["vertices"])


def union(obstacles: Iterable[Obstacle]) -> shapely.Geometry | None:
    """Unite obstacles at their initial states; None without obstacles. The result is prepared for many queries."""
    parts = [geometry(obstacle["shape"], obstacle["state"]) for obstacle in obstacles]
    if not parts:
        return None
    try:
        whole = shapely.union_all(parts)
    except shapely.GEOSException:  # of edges that nearly coincide
        whole = shapely.union_all(parts, grid_size=SNAP_M)
    shapely.prepare(whole)
    return whole


def filled(obstacle: Obstacle) -> Obstacle:
    """Return an obstacle whose line string, if it is closed, counts as the area inside."""
    line = obstacle["shape"]["vertices"]
    return {**obstacle, "shape": {"name": "polygon", "vertices": line}} if line[0] == line[-1] else obstacle


def boundaries(obstacles: Iterable[Obstacle]) -> list[Line]:
    """Return the outlines of obstacles at their initial states as lines of points x, y [m], closed around areas."""
    lines = []
    for obstacle in obstacles:
        whole = geometry(obstacle["shape"], obstacle["state"])
        line = whole if obstacle["shape"]["name"] == "linestring" else whole.exterior
        lines.append([[float(x), float(y)] for x, y in line.coords])
    return lines
