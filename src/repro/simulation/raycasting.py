"""Ray casting for all scans of a recording at once, with the equations that IR-SIM applies to one scan."""

import numpy as np

from repro.outlines import placed, without_padding
from repro.system.errors import InputError

GRAZE_M = 1e-9  # from a beam to a corner; rounding decides whether IR-SIM's beam hits there
_MAX_SIDES = 4_000_000  # beams times corners at once, to bound the memory


def scan(
    poses: np.ndarray, angles: np.ndarray, outlines: np.ndarray, states: np.ndarray, range_max_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute all scans of a recording: the nearest crossing of every beam with every outline.

    A beam is tested against an outline only if it passes through the circle around its origin, or begins in it. A
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
        distance = np.linalg.norm(offset, axis=-1)
        rings = _rings(outline, state)
        begins_in = distance <= radius
        if _contains(rings[:, begins_in], poses[begins_in, :2]).any():
            raise InputError(f"obstacle {index} reaches the robot: enlarge clear_radius_m")
        along = np.einsum("td,tnd->tn", offset, directions)
        passes = distance[:, None] ** 2 - along**2 <= np.square(radius)[..., None]
        near = passes & (along > 0) | begins_in[:, None]
        step, beam = np.nonzero(near)
        parts = np.array_split(np.arange(len(step)), 1 + len(step) * rings.shape[-1] // _MAX_SIDES)
        hit = np.concatenate([_cross(poses[:, :2], directions[step[k], beam[k]], rings, step[k]) for k in parts])
        hit[hit > range_max_m] = np.inf
        closer = hit < ranges[step, beam]
        ranges[step[closer], beam[closer]] = hit[closer]
        nearest[step[closer], beam[closer]] = index
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


def _cross(origins: np.ndarray, directions: np.ndarray, rings: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Compute the distance along K beams to the ring of their step [m], (K,); inf without a crossing.

    Args:
        origins: origin of the beams at every step, (T, 2).
        directions: unit vector of each beam, (K, 2).
        rings: x and y of the vertices at every step, (2, T, V).
        step: step of each beam, (K,).
    """
    edges = np.roll(rings, -1, axis=-1) - rings
    to_origin = origins.T[..., None] - rings  # (2, T, V)
    # Signed distance of each vertex to the beam [m]; the few edges with ends on both sides are the only candidates
    side = to_origin[1, step] * directions[:, :1] - to_origin[0, step] * directions[:, 1:]
    left, right = side >= -1e-6, side <= 1e-6
    beam, vertex = np.nonzero((left | np.roll(left, -1, axis=1)) & (right | np.roll(right, -1, axis=1)))
    (x, y), (edge_x, edge_y) = to_origin[:, step[beam], vertex], edges[:, step[beam], vertex]
    dx, dy = directions[beam].T
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = edge_y * dx - edge_x * dy
        u = (y * dx - x * dy) / denominator
        t = (edge_x * y - edge_y * x) / denominator
    crossed = (u >= 0) & (u <= 1) & (t > 1e-9)
    nearest = np.full(len(directions), np.inf)
    np.minimum.at(nearest, beam[crossed], t[crossed])
    return nearest


def _rings(outline: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return x and y of an outline (V, 2), or one per state (T, V, 2), at each state (T, 3), (2, T, V)."""
    shape = without_padding(outline) if outline.ndim == 2 else outline
    return np.ascontiguousarray(np.moveaxis(placed(shape, states), -1, 0))
