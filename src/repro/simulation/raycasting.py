"""Ray casting for all scans of a recording at once, with the equations that IR-SIM applies to one scan."""

import math

import numpy as np

from repro.outlines import placed
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
    rings = placed(outlines if outlines.ndim == 4 else outlines[:, None], states)  # (O, T, V, 2)
    radii = np.linalg.norm(outlines, axis=-1).max(axis=-1).reshape(len(outlines), -1)  # (O, 1 or T)
    offsets = states[..., :2] - poses[:, :2]  # (O, T, 2)
    ranges, nearest = np.full(heading.shape, np.inf), np.full(heading.shape, -1)
    radii = np.broadcast_to(radii, offsets.shape[:2])
    reached = _cast(ranges, nearest, poses, directions, rings, offsets, radii, range_max_m)
    if reached >= 0:
        raise InputError(f"obstacle {reached} reaches the robot: enlarge clear_radius_m")
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
    corners = placed(outlines, states[:, 0])  # (O, V, 2)
    return any(
        bool((np.abs(cos * (y - poses[:, 1:2]) - sin * (x - poses[:, :1])) <= GRAZE_M).any())
        for x, y in np.unique(corners.reshape(-1, 2), axis=0)
    )


@compiled
def _cast(
    ranges: np.ndarray,
    nearest: np.ndarray,
    poses: np.ndarray,
    directions: np.ndarray,
    rings: np.ndarray,
    offsets: np.ndarray,
    radii: np.ndarray,
    range_max_m: float,
) -> int:
    """Shorten the ranges of all beams to the rings that they cross; return an obstacle that contains a robot, or -1.

    Args:
        ranges: ranges so far [m], (T, N).
        nearest: index of the obstacle that each beam hits, (T, N).
        poses: robot poses, (T, 3).
        directions: unit vectors of the beams, (T, N, 2).
        rings: outlines in the world, (O, T, V, 2).
        offsets: from the robot to the origin of each outline [m], (O, T, 2).
        radii: of the circles around the outlines [m], (O, T).
        range_max_m: longest range [m].
    """
    for index in range(len(rings)):
        for step in range(len(ranges)):
            across, up, radius = offsets[index, step, 0], offsets[index, step, 1], radii[index, step]
            square = across * across + up * up
            if math.sqrt(square) - radius > range_max_m:
                continue
            corners = rings.shape[2]
            while (
                corners > 2
                and rings[index, step, corners - 1, 0] == rings[index, step, corners - 2, 0]
                and rings[index, step, corners - 1, 1] == rings[index, step, corners - 2, 1]
            ):
                corners -= 1  # without those that pad the outline
            ring = rings[index, step, :corners]
            if square <= radius * radius and _contains(ring, poses[step]):
                return index
            for beam in range(ranges.shape[1]):
                dx, dy = directions[step, beam]
                along = across * dx + up * dy
                if square <= radius * radius or (along > 0 and square - along * along <= radius * radius):
                    distance = _crossing(ring, poses[step], dx, dy)
                    if distance <= range_max_m and distance < ranges[step, beam]:
                        ranges[step, beam], nearest[step, beam] = distance, index
    return -1


@compiled
def _contains(ring: np.ndarray, pose: np.ndarray) -> bool:
    """Check whether a ring (V, 2) contains the robot, by counting crossings."""
    is_inside, start = False, len(ring) - 1
    for end in range(len(ring)):
        x0, y0, x1, y1 = ring[start, 0], ring[start, 1], ring[end, 0], ring[end, 1]
        if (y0 <= pose[1]) != (y1 <= pose[1]):
            is_inside ^= x0 + (pose[1] - y0) * (x1 - x0) / (y1 - y0) > pose[0]
        start = end
    return is_inside


@compiled
def _crossing(ring: np.ndarray, pose: np.ndarray, dx: float, dy: float) -> float:
    """Return the distance from the robot along a direction to a ring (V, 2) [m], inf without a crossing."""
    shortest, start = math.inf, len(ring) - 1
    x, y = pose[0] - ring[start, 0], pose[1] - ring[start, 1]
    side = y * dx - x * dy  # signed distance of the corner to the beam [m]
    for end in range(len(ring)):
        end_x, end_y = pose[0] - ring[end, 0], pose[1] - ring[end, 1]
        end_side = end_y * dx - end_x * dy
        if min(side, end_side) <= 1e-6 and max(side, end_side) >= -1e-6:
            edge_x, edge_y = ring[end, 0] - ring[start, 0], ring[end, 1] - ring[start, 1]
            denominator = edge_y * dx - edge_x * dy
            if denominator != 0:
                u, distance = (y * dx - x * dy) / denominator, (edge_x * y - edge_y * x) / denominator
                if 0 <= u <= 1 and 1e-9 < distance < shortest:
                    shortest = distance
        start, x, y, side = end, end_x, end_y, end_side
    return shortest
