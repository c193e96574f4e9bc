"""Discs and rectangles with constant velocity, fitted to hits by the Levenberg-Marquardt method, in compiled loops.

A state is x, y [m] and velocity [m/s] at the last step, radius [m], logarithm of the aspect, and heading [rad], (7,).
The radius of a rectangle is that of the disc of the same area. A disc uses the first five.
"""

import numpy as np

from repro.system.compiled import compiled

ITERATIONS = 10
FARTHEST_M = 8.0  # from the center of an obstacle; no drawn outline is farther away


@compiled
def fit(
    start: np.ndarray, is_disc: bool, hits: np.ndarray, edges: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, float]:
    """Fit a shape; return its state and its cost, the sum of the squares of `_residuals`.

    Args:
        start: the state to start from, (7,).
        is_disc: whether to fit a disc; otherwise a rectangle.
        hits: x, y [m] and time, 0 at the last step [s], then unused columns, (H, 3 or more).
        edges: x, y [m], time [s], cosine, sine of a line of sight that touches the shape, and on which side of it the
            shape is, 1 for its left or -1, (E, 6).
        prior: standard deviation of the distances of the outline to all hits, or to all edges, together [m]; mean and
            standard deviation of the radius [m]; mean and standard deviation of the log aspect; standard deviation of
            each component of the velocity [m/s].
    """
    state, damping, count = start.copy(), 1e-2, 5 if is_disc else 7
    residuals = _residuals(state, is_disc, hits, edges, prior)
    cost = (residuals**2).sum()
    slope = np.empty((len(residuals), count))
    for _ in range(ITERATIONS):
        for which in range(count):
            moved = state.copy()
            moved[which] += 1e-5
            changed = _residuals(moved, is_disc, hits, edges, prior)
            for index in range(len(changed)):  # loops, since the compiler takes seconds for operations on slices
                slope[index, which] = (changed[index] - residuals[index]) / 1e-5
        normal = slope.T @ slope
        for which in range(count):
            normal[which, which] += damping * normal[which, which] + 1e-9
        step = np.linalg.solve(normal, slope.T @ residuals)
        moved = state.copy()
        for which in range(count):
            moved[which] -= step[which]
        new = _residuals(moved, is_disc, hits, edges, prior)
        if (new**2).sum() < cost:
            state, residuals, cost, damping = moved, new, (new**2).sum(), 0.3 * damping
        else:
            damping *= 5
    return state, cost


@compiled
def draw(nearest: np.ndarray, resolution_m: float, state: np.ndarray, is_disc: bool) -> None:
    """Lower the distance of each pixel to the nearest outline (H, W) [m], negative inside, to that of a shape."""
    length, width, cos, sin = _half_sides(state, is_disc)
    size = len(nearest)
    for row in range(size):
        y = (size - 0.5 - row) * resolution_m - state[1]
        if abs(y) > FARTHEST_M:
            continue
        for column in range(size):
            x = (column + 0.5) * resolution_m - state[0]
            if abs(x) <= FARTHEST_M:
                nearest[row, column] = min(nearest[row, column], _distance(x, y, is_disc, length, width, cos, sin))


@compiled
def _residuals(state: np.ndarray, is_disc: bool, hits: np.ndarray, edges: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return the normalized residuals of hits, edges, velocity, radius and aspect, (H + E + 4,)."""
    x, y, vx, vy, radius, log_aspect, _ = state
    noise_m, radius_m, spread_m, mean_log_aspect, spread_log_aspect, speed_m_s = prior
    length, width, cos, sin = _half_sides(state, is_disc)
    residuals = np.empty(len(hits) + len(edges) + 4)
    for index in range(len(hits)):
        to_x, to_y = hits[index, 0] - x - vx * hits[index, 2], hits[index, 1] - y - vy * hits[index, 2]
        residuals[index] = _distance(to_x, to_y, is_disc, length, width, cos, sin) / (noise_m * np.sqrt(len(hits)))
    for index in range(len(edges)):
        from_x, from_y, when, sight_cos, sight_sin, side = edges[index]
        aside = side * (sight_cos * (y + vy * when - from_y) - sight_sin * (x + vx * when - from_x))
        half = length
        if not is_disc:
            half = length * abs(sight_cos * sin - sight_sin * cos) + width * abs(sight_sin * sin + sight_cos * cos)
        residuals[len(hits) + index] = (aside - half) / (noise_m * np.sqrt(len(edges)))
    residuals[-4], residuals[-3], residuals[-2] = vx / speed_m_s, vy / speed_m_s, (radius - radius_m) / spread_m
    residuals[-1] = 0.0 if is_disc else (log_aspect - mean_log_aspect) / spread_log_aspect
    return residuals


@compiled
def _half_sides(state: np.ndarray, is_disc: bool) -> tuple[float, float, float, float]:
    """Return half the length and width of a shape [m], and cosine and sine of its heading."""
    radius, aspect = state[4], np.exp(state[5])
    if is_disc:
        return radius, radius, 1.0, 0.0
    width = 0.5 * np.sqrt(np.pi / aspect) * radius
    return aspect * width, width, np.cos(state[6]), np.sin(state[6])


@compiled
def _distance(x: float, y: float, is_disc: bool, length: float, width: float, cos: float, sin: float) -> float:
    """Return the distance of a point to the outline of a shape at the origin [m], negative inside."""
    if is_disc:
        return np.hypot(x, y) - length
    beyond_x, beyond_y = abs(x * cos + y * sin) - length, abs(y * cos - x * sin) - width
    return np.hypot(max(beyond_x, 0.0), max(beyond_y, 0.0)) + min(max(beyond_x, beyond_y), 0.0)
