"""Compiled draws of the motion of an obstacle: keep those that agree with the scans, count the pixels they cover."""

import math

import numpy as np

from repro.system.compiled import compiled

TOLERANCE_M = 0.02  # a beam that enters an obstacle by less than this may have ended on it; ranges are float32


@compiled
def draw_ends(
    outline: np.ndarray,
    start: np.ndarray,
    law: tuple[float, float, float, float, int, int],
    scans: tuple[np.ndarray, np.ndarray, np.ndarray],
    wanted: int,
    most: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, int]:
    """Draw where an obstacle is after the last step, as `drift.Drift` moves it, given that no scan hits it.

    Args:
        outline: its outline at its heading around its origin [m], (V, 2).
        start: its x, y [m], velocity x, y [m/s] and steps since the last random turn, (5,).
        law: duration of a step [s], x and y of the center [m], distance that the outline keeps from it [m], and the
            minimum and maximum number of steps between two random turns.
        scans: ranges of the later steps [m], (T, N), with the maximum range for a miss; beam angles [rad], (N,); poses,
            (T, 3).
        wanted: number of draws to keep.
        most: number of draws to try.
        rng: random generator.

    Returns:
        the positions of the kept draws [m], (K, 2), and the number of tried draws.
    """
    ends = np.empty((wanted, 2))
    kept = tried = 0
    while kept < wanted and tried < most:
        x, y, is_hit = _move(outline, start, law, scans, rng)
        tried += 1
        if not is_hit:
            ends[kept, 0], ends[kept, 1] = x, y
            kept += 1
    return ends[:kept], tried


@compiled
def _move(
    outline: np.ndarray,
    start: np.ndarray,
    law: tuple[float, float, float, float, int, int],
    scans: tuple[np.ndarray, np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> tuple[float, float, bool]:
    """Move an obstacle from a start to the last step or its first hit; return x, y [m] and whether a scan hits it."""
    ranges, angles, poses = scans
    step_s, center_x, center_y, clear_m, least, longest = law
    x, y, vx, vy, passed = start
    radius = math.sqrt((outline[:, 0] ** 2 + outline[:, 1] ** 2).max())
    speed, since = math.hypot(vx, vy), int(passed)
    countdown = rng.integers(max(least, since), longest + 1) - since
    for step in range(len(ranges)):
        if countdown == 0:
            bearing = rng.uniform(-math.pi, math.pi)
            vx, vy = speed * math.cos(bearing), speed * math.sin(bearing)
            countdown = rng.integers(least, longest + 1)
        countdown -= 1
        away_x, away_y = x - center_x, y - center_y
        next_m = math.hypot(away_x + vx * step_s, away_y + vy * step_s)
        if next_m < clear_m + radius and vx * away_x + vy * away_y < 0:
            bearing = math.atan2(away_y, away_x) + rng.uniform(-math.pi / 2, math.pi / 2)
            vx, vy = speed * math.cos(bearing), speed * math.sin(bearing)
        x, y = x + vx * step_s, y + vy * step_s
        if _is_hit(outline, radius, x, y, ranges[step], angles, poses[step]):
            return x, y, True
    return x, y, False


@compiled
def unseen(
    corners: np.ndarray, paths: np.ndarray, scans: tuple[np.ndarray, np.ndarray, np.ndarray], wanted: int
) -> np.ndarray:
    """Return the first drawn motions that no beam of the scans would have hit.

    Args:
        corners: outlines at their headings around their origins [m], (D, V, 2).
        paths: positions at every step [m], (D, T, 2).
        scans: as for `draw_ends`.
        wanted: number of draws to return, at most.

    Returns:
        indices of the draws, (K,).
    """
    kept = np.empty(wanted, dtype=np.int64)
    count = 0
    for draw in range(len(corners)):
        if count < wanted and not _is_ever_hit(corners[draw], paths[draw], scans):
            kept[count] = draw
            count += 1
    return kept[:count]


@compiled
def _is_ever_hit(outline: np.ndarray, path: np.ndarray, scans: tuple[np.ndarray, np.ndarray, np.ndarray]) -> bool:
    ranges, angles, poses = scans
    radius = math.sqrt((outline[:, 0] ** 2 + outline[:, 1] ** 2).max())
    for step in range(len(ranges)):
        if _is_hit(outline, radius, path[step, 0], path[step, 1], ranges[step], angles, poses[step]):
            return True
    return False


@compiled
def count_cover(corners: np.ndarray, ends: np.ndarray, size_px: int, size_m: float) -> np.ndarray:
    """Count how many convex outlines cover the center of each pixel, by the rule of `ground_truth.rasterize`.

    Args:
        corners: outline of each draw around its origin [m], (K, V, 2), or of all, (1, V, 2).
        ends: position of each draw [m], (K, 2).
        size_px: pixels along one side of the map.
        size_m: side of the map [m].

    Returns:
        the number of draws that cover each pixel, int32, (H, W).
    """
    cover = np.zeros((size_px, size_px), dtype=np.int32)
    resolution = size_m / size_px
    for draw in range(len(ends)):
        outline, x, y = corners[min(draw, len(corners) - 1)], ends[draw, 0], ends[draw, 1]
        top = min(size_px - 1, math.ceil((y + outline[:, 1].max()) / resolution - 0.5))
        bottom = max(0, math.floor((y + outline[:, 1].min()) / resolution - 0.5))
        for up in range(bottom, top + 1):
            left, right = math.inf, -math.inf
            level = (up + 0.5) * resolution - y
            for corner in range(len(outline)):
                x0, y0 = outline[corner]
                x1, y1 = outline[(corner + 1) % len(outline)]
                if (y0 <= level) != (y1 <= level):
                    crossing = x0 + (level - y0) * (x1 - x0) / (y1 - y0)
                    left, right = min(left, crossing), max(right, crossing)
            if left < right:
                first = min(size_px, max(0, math.ceil((x + left) / resolution - 0.5)))
                last = min(size_px, max(0, math.ceil((x + right) / resolution - 0.5)))
                cover[size_px - 1 - up, first:last] += 1
    return cover


@compiled
def newest_hit(
    outline: np.ndarray, positions: np.ndarray, ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray
) -> int:
    """Return the newest step at which a beam ended on an obstacle, counted from 1, 0 for never.

    Args:
        outline: outline at its heading around its origin [m], (V, 2).
        positions: x and y of the obstacle at every step [m], (T, 2).
        ranges: ranges [m], (T, N), inf for a miss.
        angles: beam angles [rad], (N,).
        poses: poses of the robot, (T, 3).
    """
    reach = math.sqrt((outline[:, 0] ** 2 + outline[:, 1] ** 2).max()) + TOLERANCE_M
    for step in range(len(ranges) - 1, -1, -1):
        x, y = positions[step, 0] - poses[step, 0], positions[step, 1] - poses[step, 1]
        for beam in range(len(angles)):
            length, heading = ranges[step, beam], poses[step, 2] + angles[beam]
            cos, sin = math.cos(heading), math.sin(heading)
            is_near = math.isfinite(length) and math.hypot(length * cos - x, length * sin - y) <= reach
            if is_near and abs(_entry(outline, x, y, cos, sin) - length) <= TOLERANCE_M:
                return step + 1
    return 0


@compiled
def _is_hit(
    outline: np.ndarray, radius: float, x: float, y: float, ranges: np.ndarray, angles: np.ndarray, pose: np.ndarray
) -> bool:
    """Return whether a beam enters a convex outline at (x, y) before its range."""
    away_x, away_y = x - pose[0], y - pose[1]
    distance = math.hypot(away_x, away_y)
    bearing = math.atan2(away_y, away_x) - pose[2]
    half = math.pi if distance <= radius else math.asin(radius / distance)
    spacing = angles[1] - angles[0]
    turn = 2 * math.pi * math.floor((bearing - angles[0] + math.pi) / (2 * math.pi))
    for wrapped in (bearing - turn, bearing - turn + 2 * math.pi):
        first = max(0, math.ceil((wrapped - half - angles[0]) / spacing))
        last = min(len(angles) - 1, math.floor((wrapped + half - angles[0]) / spacing))
        for beam in range(first, last + 1):
            if ranges[beam] - TOLERANCE_M <= distance - radius:
                continue  # the beam ends in front of the circle around the outline
            cos, sin = math.cos(pose[2] + angles[beam]), math.sin(pose[2] + angles[beam])
            if _entry(outline, away_x, away_y, cos, sin) < ranges[beam] - TOLERANCE_M:
                return True
    return False


@compiled
def _entry(outline: np.ndarray, x: float, y: float, cos: float, sin: float) -> float:
    """Return the distance along a beam from the origin to an outline around (x, y) [m], inf without a crossing."""
    nearest = math.inf
    last_along = last_side = 0.0
    for corner in range(-1, len(outline)):
        at_x, at_y = outline[corner, 0] + x, outline[corner, 1] + y
        along, side = at_x * cos + at_y * sin, at_y * cos - at_x * sin
        if corner >= 0 and (side > 0) != (last_side > 0):
            distance = last_along + (along - last_along) * last_side / (last_side - side)
            if 0 < distance < nearest:
                nearest = distance
        last_along, last_side = along, side
    return nearest
