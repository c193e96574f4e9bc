"""Loops of the planner over pixels and over the points of arcs."""

import numpy as np

from repro.system.compiled import compiled

LETHAL = 2.0  # of the risk, for the largest p that touches the robot: more than an arc can gain
OUTSIDE = 1.0  # probability of an obstacle beyond the border


@compiled
def inflate(maps: np.ndarray, fall: np.ndarray, inflated: np.ndarray) -> None:
    """Spread maps (M, H, W) by the weights of the distances, (2 R + 1, 2 R + 1), into maps of zeros."""
    size, reach = maps.shape[1], len(fall) // 2
    for index in range(len(maps)):
        for row in range(size):
            filled = np.flatnonzero(maps[index, row])
            if not len(filled):
                continue
            for to_row in range(max(0, row - reach), min(size, row + reach + 1)):
                for right in range(-reach, reach + 1):
                    weight = fall[to_row - row + reach, right + reach]
                    if weight > 0:
                        first, last = max(filled[0], -right), min(filled[-1], size - 1 - right)
                        source = maps[index, row, first : last + 1]
                        target = inflated[index, to_row, first + right : last + 1 + right]
                        for column in range(len(source)):  # without a branch, for the vector unit
                            target[column] = max(target[column], source[column] * weight)


@compiled
def roll_out(
    to_go: np.ndarray, inflated: np.ndarray, lethal: np.ndarray, points: np.ndarray, layer: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cost to go from the ends of arcs, and their risks, each (E, A).

    Args:
        to_go: costs to the goals, (E, H, W).
        inflated: inflated maps, (E, K, H, W).
        lethal: maps inflated by the robot's radius, (E, K, H, W).
        points: x, y [px], (E, A, P, 2).
        layer: the map of each point, (P,).
    """
    robots, number, steps = points.shape[:3]
    left, risk = np.empty((2, robots, number))
    for robot in range(robots):
        for arc in range(number):
            total, worst = 0.0, 0.0
            for step in range(steps):
                x, y = points[robot, arc, step]
                total += _read(inflated[robot, layer[step]], x, y, OUTSIDE)
                worst = max(worst, _read(lethal[robot, layer[step]], x, y, OUTSIDE))
            left[robot, arc] = _read(to_go[robot], x, y, np.inf)
            risk[robot, arc] = total / steps + LETHAL * worst
    return left, risk


@compiled
def _read(image: np.ndarray, x: float, y: float, outside: float) -> float:
    """Interpolate a map (H, W) at a point [px], with a value for one outside."""
    size = len(image)
    if not (0 <= x < size and 0 <= y < size):
        return outside
    column, row = min(max(x - 0.5, 0.0), size - 1.001), min(max(size - y - 0.5, 0.0), size - 1.001)
    left, top = int(column), int(row)
    right, below = column - left, row - top
    upper = image[top, left] * (1 - right) + image[top, left + 1] * right
    lower = image[top + 1, left] * (1 - right) + image[top + 1, left + 1] * right
    return upper * (1 - below) + lower * below
