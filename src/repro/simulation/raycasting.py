"""Ray casting for all scans of a recording at once, with the equations that IR-SIM applies to one scan."""

import math
from typing import NamedTuple

import numpy as np

from repro.maps.outlines import placed
from repro.system.compiled import compiled
from repro.system.errors import InputError

_MARGIN = 1e-6  # of circles and angles outside of which no crossing is sought
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
        InputError: an obstacle contains the center of the robot.
    """
    heading = poses[:, 2:] + angles  # (T, N)
    directions = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    outlines = outlines if outlines.ndim == 4 else outlines[:, None]
    view = np.stack([poses[:, 2] + (angles[0] + angles[-1]) / 2, np.full(len(poses), np.ptp(angles) / 2)], axis=-1)
    ranges, nearest = np.full(heading.shape, np.inf), np.full(heading.shape, -1)
    beams = _Beams(poses, directions, view, ranges, nearest)
    stands = (states == states[:, :1]).all((1, 2)) & (outlines.shape[1] == 1)
    for numbers, steps in ((np.flatnonzero(stands), slice(1)), (np.flatnonzero(~stands), slice(None))):
        rings = placed(outlines[numbers], states[numbers, steps])  # (R, 1 or T, V, 2)
        reached = _cast(beams, _Rings(numbers, rings), range_max_m)
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
    is_corner = (np.diff(outlines, axis=1, prepend=np.nan) != 0).any(-1)  # the others pad the outline
    corners = placed(outlines, states[:, 0])[is_corner]
    return _grazes(np.unique(corners, axis=0), poses, np.cos(heading), np.sin(heading))


@compiled
def _grazes(corners: np.ndarray, poses: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> bool:
    """Check whether any beam, of directions `cos`, `sin` (T, N), passes through a corner, (C, 2)."""
    for corner in corners:
        for step in range(len(poses)):
            x, y = corner[0] - poses[step, 0], corner[1] - poses[step, 1]
            for beam in range(cos.shape[1]):
                if abs(cos[step, beam] * y - sin[step, beam] * x) <= GRAZE_M:
                    return True
    return False


class _Beams(NamedTuple):
    """The beams of T scans.

    Args:
        poses: robot poses, (T, 3).
        directions: unit vectors of the beams, (T, N, 2).
        facing: direction of the middle of the view and half of the field of view [rad], (T, 2).
        ranges: ranges so far [m], (T, N).
        nearest: index of the obstacle that each beam hits, (T, N).
    """

    poses: np.ndarray
    directions: np.ndarray
    facing: np.ndarray
    ranges: np.ndarray
    nearest: np.ndarray


class _Rings(NamedTuple):
    """Outlines in the world.

    Args:
        numbers: indices of their obstacles, (R,).
        outlines: the outlines [m], (R, S, V, 2), where S is T, or 1 if they stand.
    """

    numbers: np.ndarray
    outlines: np.ndarray


@compiled
def _cast(beams: _Beams, rings: _Rings, range_max_m: float) -> int:
    """Shorten the ranges of all beams to the rings that they cross; return an obstacle that contains a robot, or -1."""
    for place in range(len(rings.numbers)):
        index = rings.numbers[place]
        for step in range(len(beams.ranges)):
            at, pose = step if rings.outlines.shape[1] > 1 else 0, beams.poses[step]
            if at or not step:
                center_x, center_y, radius = _circle(rings.outlines[place, at])
            across, up = center_x - pose[0], center_y - pose[1]
            square = across * across + up * up
            if not _may_be_hit(across, up, radius, beams.facing[step], range_max_m):
                continue
            ring = _unpadded(rings.outlines[place, at])
            if square <= radius * radius and _contains(ring, pose):
                return index
            for beam in range(beams.ranges.shape[1]):
                dx, dy = beams.directions[step, beam]
                along = across * dx + up * dy
                if square <= radius * radius or (along > 0 and square - along * along <= radius * radius):
                    distance = _crossing(ring, pose, dx, dy)
                    if distance <= range_max_m and distance < beams.ranges[step, beam]:
                        beams.ranges[step, beam], beams.nearest[step, beam] = distance, index
    return -1


@compiled
def _circle(ring: np.ndarray) -> tuple[float, float, float]:
    """Return the center of a circle around a ring (V, 2), x, y [m], and its radius [m]."""
    x, y = (ring[:, 0].min() + ring[:, 0].max()) / 2, (ring[:, 1].min() + ring[:, 1].max()) / 2
    return x, y, math.sqrt(((ring[:, 0] - x) ** 2 + (ring[:, 1] - y) ** 2).max()) + _MARGIN


@compiled
def _may_be_hit(across: float, up: float, radius: float, view: np.ndarray, range_max_m: float) -> bool:
    """Check whether a circle at a place from the robot [m] may be within range and view, see `_cast`."""
    square = across * across + up * up
    if math.sqrt(square) - radius > range_max_m:
        return False
    if square <= radius * radius:
        return True
    aside = math.atan2(up, across) - view[0]
    aside = abs(aside - 2 * math.pi * round(aside / (2 * math.pi)))
    return aside <= view[1] + math.asin(radius / math.sqrt(square)) + _MARGIN  # for rounding


@compiled
def _unpadded(ring: np.ndarray) -> np.ndarray:
    """Return a ring (V, 2) without the corners that pad it, which repeat the last one."""
    corners = len(ring)
    while corners > 2 and ring[corners - 1, 0] == ring[corners - 2, 0] and ring[corners - 1, 1] == ring[corners - 2, 1]:
        corners -= 1
    return ring[:corners]


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
