"""Ray casting for all scans of a recording at once, with the equations that IR-SIM applies to one scan."""

import math

import numpy as np

from repro.outlines import placed, without_padding
from repro.system.compiled import compiled
from repro.system.errors import InputError

GRAZE_M = 1e-9  # from a beam to a corner; rounding decides whether IR-SIM's beam hits there


def scan(
    poses: np.ndarray, angles: np.ndarray, outlines: np.ndarray, states: np.ndarray, range_max_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute all scans of a recording: the nearest crossing of every beam with every outline.

    A beam is tested against an outline only if it passes through the circle around it, or begins in it. A
    crossing solves origin + t * direction = a + u * (b - a) with 0 < t <= range_max and 0 <= u <= 1, as IR-SIM does.

    Args:
        poses: robot poses x, y [m], heading [rad], (T, 3).
        angles: beam angles in the robot's frame [rad], (N,).
        outlines: obstacle outlines in their own frame [m], (O, V, 2), or (O, T, V, 2) if they differ from scan to scan;
            a line string goes there and back.
        states: obstacle poses x, y [m], heading [rad], (O, T, 3).
        range_max_m: longest range [m].

    Returns:
        ranges [m], (T, N), inf for a miss; and whether each obstacle was hit, (O,).

    Raises:
        ValueError: an obstacle contains the center of the robot.
    """
    heading = poses[:, 2:] + angles  # (T, N)
    directions = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    ranges = np.full(heading.shape, np.inf)
    nearest = np.full(heading.shape, -1)
    for index, (outline, state) in enumerate(zip(outlines, states, strict=True)):
        radius = np.linalg.norm(outline, axis=-1).max(axis=-1)  # () or (T,)
        offset = state[:, :2] - poses[:, :2]  # (T, 2)
        begins_in = np.linalg.norm(offset, axis=-1) <= radius
        rings = _rings(outline, state)
        if _contains(rings[:, begins_in], poses[begins_in, :2]).any():
            raise InputError(f"obstacle {index} reaches the robot: enlarge clear_radius_m")
        around = np.column_stack([offset, np.broadcast_to(radius, len(offset))])
        _cross(ranges, nearest, index, np.ascontiguousarray(poses[:, :2]), directions, rings, around, range_max_m)
    return ranges, np.isin(np.arange(len(outlines)), nearest)


def grazes(poses: np.ndarray, angles: np.ndarray, outlines: np.ndarray, states: np.ndarray) -> bool:
    """Check whether any beam passes through a corner, or along an edge, of obstacles that stand.

    Args:
        poses: robot poses x, y [m], heading [rad], (T, 3).
        angles: beam angles in the robot's frame [rad], (N,).
        outlines: obstacle outlines in their own frame [m], (O, V, 2).
        states: obstacle poses x, y [m], heading [rad], (O, T, 3).
    """
    heading = poses[:, 2:] + angles
    cos, sin = np.cos(heading), np.sin(heading)
    corners = [_rings(outline, state[:1])[:, 0].T for outline, state in zip(outlines, states, strict=True)]
    return any(
        bool((np.abs(cos * (y - poses[:, 1:2]) - sin * (x - poses[:, :1])) <= GRAZE_M).any())
        for x, y in np.unique(np.concatenate(corners), axis=0)
    )


def _contains(rings: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Check whether each point (K, 2) is inside its ring, x and y of the vertices, (2, K, V), by counting crossings."""
    (x0, y0), (x1, y1) = rings, np.roll(rings, -1, axis=-1)
    x, y = points.T[..., None]
    crosses = (y0 <= y) != (y1 <= y)
    at = x0 + (y - y0) * (x1 - x0) / np.where(crosses, y1 - y0, 1)
    return (crosses & (at > x)).sum(axis=-1) % 2 == 1


@compiled
def _cross(
    ranges: np.ndarray,
    nearest: np.ndarray,
    index: int,
    origins: np.ndarray,
    directions: np.ndarray,
    rings: np.ndarray,
    around: np.ndarray,
    range_max_m: float,
) -> None:
    """Shorten the ranges of all scans to the ring of one obstacle, where it is nearer.

    Args:
        ranges: ranges so far [m], (T, N).
        nearest: index of the obstacle that each beam hits, (T, N).
        index: that of this obstacle.
        origins: origins of the beams, (T, 2).
        directions: unit vectors of the beams, (T, N, 2).
        rings: x and y of the vertices, (2, T, V).
        around: circle around the ring: center from the origin of the beams and radius [m], (T, 3).
        range_max_m: longest range [m].
    """
    vertices = rings.shape[2]
    for step in range(len(ranges)):
        across, up, radius = around[step]
        square = across * across + up * up
        if math.sqrt(square) - radius > range_max_m:
            continue
        for beam in range(ranges.shape[1]):
            dx, dy = directions[step, beam]
            along = across * dx + up * dy
            if square > radius * radius and (along <= 0 or square - along * along > radius * radius):
                continue
            for vertex in range(vertices):
                following = vertex + 1 if vertex + 1 < vertices else 0
                x, y = origins[step, 0] - rings[0, step, vertex], origins[step, 1] - rings[1, step, vertex]
                end_x = origins[step, 0] - rings[0, step, following]
                end_y = origins[step, 1] - rings[1, step, following]
                side, end_side = y * dx - x * dy, end_y * dx - end_x * dy  # signed distance to the beam [m]
                if min(side, end_side) > 1e-6 or max(side, end_side) < -1e-6:
                    continue
                edge_x = rings[0, step, following] - rings[0, step, vertex]
                edge_y = rings[1, step, following] - rings[1, step, vertex]
                denominator = edge_y * dx - edge_x * dy
                if denominator == 0:
                    continue
                u, t = (y * dx - x * dy) / denominator, (edge_x * y - edge_y * x) / denominator
                if 0 <= u <= 1 and 1e-9 < t <= range_max_m and t < ranges[step, beam]:
                    ranges[step, beam] = t
                    nearest[step, beam] = index


def _rings(outline: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return x and y of an outline (V, 2), or one per state (T, V, 2), at each state (T, 3), (2, T, V)."""
    shape = without_padding(outline) if outline.ndim == 2 else outline
    return np.ascontiguousarray(np.moveaxis(placed(shape, states), -1, 0))
