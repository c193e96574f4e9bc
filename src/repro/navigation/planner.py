"""The planner of all mappers: a cost-to-go on the map, and arcs that are rolled out over it.

The probability of an obstacle p is inflated: the largest one within a radius. A meter costs 1 + weight p. Dijkstra's
algorithm gives the cost from the pixels around the robot to the goal. Of the arcs of constant speed and turn over two
seconds, as in the dynamic window approach (Fox, Burgard and Thrun 1997), the robot takes the one with the least sum of
the cost from its end to the goal, of a risk times the weight times the longest way, and, if it drives backward, of the
longest way. The risk is the mean of the inflated p along the arc and `LETHAL` times the largest p within the robot's
radius. With `Settings.look`, obstacles that are expected unseen on the arc cost, too.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from repro.maps.grid import Grid
from repro.maps.outlines import placed
from repro.system.compiled import compiled

HORIZON_S = 2.0  # of an arc
LAYER_S = 0.5  # from one map of the future to the next
TIMES_S = np.arange(1, 11) * HORIZON_S / 10  # of the points of an arc at which the map is read
SPEEDS = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the largest
TURNS = 13  # from one largest rate of turn to the other
LETHAL = 2.0  # of the risk, for the largest p that touches the robot: more than an arc can gain
OUTSIDE = 1.0  # probability of an obstacle beyond the border


@dataclass(frozen=True)
class Settings:
    """What is tuned for every mapper.

    Args:
        inflation_m: radius by which obstacles grow [m].
        weight: cost of a meter in an obstacle, in meters.
        threshold: probability above which a pixel is an obstacle; None takes the probabilities as they are.
        look: cost of a meter of an arc where an obstacle is expected unseen, in meters, so that a robot may turn its
            lidar before its path.
        unseen_s: age of the last look at a pixel from which on it is unseen when the arc enters it [s].
    """

    inflation_m: float
    weight: float
    threshold: float | None = None
    look: float = 0.0
    unseen_s: float = 0.0


class Planner:
    """Commands for many robots, each with its map.

    Args:
        grid: grid of the maps.
        settings: tuned values.
        radius_m: radius of the robots [m].
        speed_m_s: largest speed [m/s].
        turn_rad_s: largest rate of turn [rad/s].
    """

    def __init__(self, grid: Grid, settings: Settings, radius_m: float, speed_m_s: float, turn_rad_s: float) -> None:
        self.grid, self.settings, self.speed_m_s, self.longest_m = grid, settings, speed_m_s, speed_m_s * HORIZON_S
        speeds, turns = speed_m_s * np.array(SPEEDS), np.linspace(-turn_rad_s, turn_rad_s, TURNS)
        self.commands = np.array([*itertools.product(speeds, turns)])
        self.arcs = arcs(self.commands, TIMES_S)
        reach = int(settings.inflation_m / grid.resolution_m)
        offsets = grid.resolution_m * np.arange(-reach, reach + 1)
        away = np.hypot(offsets[:, None], offsets)
        core = radius_m + grid.resolution_m / 2
        fall = (settings.inflation_m - away) / max(settings.inflation_m - core, 1e-9)  # less than 0 spreads nothing
        self.fall, self.core = np.where(away <= core, 1, fall), np.where(away <= core, 1.0, 0.0)

    def plan(self, occupied: np.ndarray, poses: np.ndarray, goals: np.ndarray, *look: np.ndarray) -> np.ndarray:
        """Choose the commands of E robots.

        Args:
            occupied: probability of an obstacle now and every `LAYER_S` later, K maps, (E, K, H, W).
            poses: x, y [m], heading [rad], (E, 3).
            goals: x, y [m], (E, 2).
            look: with `Settings.look`, time since a beam passed over each pixel [s], and obstacles that are expected
                in it if it is unseen, each (E, H, W).

        Returns:
            speed [m/s] and rate of turn [rad/s], (E, 2).
        """
        return self.commands[self.costs(occupied, poses, goals, *look).argmin(1)]

    def costs(self, occupied: np.ndarray, poses: np.ndarray, goals: np.ndarray, *look: np.ndarray) -> np.ndarray:
        """Return the cost of every arc of E robots, (E, A), see `plan`; infinite where it ends off the map."""
        if self.settings.threshold is not None:
            occupied = (occupied > self.settings.threshold).astype(np.float32)
        inflated, lethal = self.inflate(occupied, self.fall), self.inflate(occupied, self.core)
        points = placed(self.arcs, poses[:, None]) / self.grid.resolution_m  # (E, A, P, 2)
        layer = np.minimum(TIMES_S // LAYER_S, occupied.shape[1] - 1).astype(int)
        cost = self.longest_m * (self.commands[:, 0] < 0) + np.zeros(points.shape[:2])
        if look:
            age_s, expected = look
            start, headings = (
                poses[:, None, :2] / self.grid.resolution_m,
                poses[:, 2:] + HORIZON_S * self.commands[:, 1],
            )
            unseen = _unseen(age_s, expected, start[:, 0], points, self.settings.unseen_s - TIMES_S)
            cost += self.settings.look * self.longest_m * unseen
            still = self.commands[:, 0] == 0  # on the spot, what counts is the cost from the pixel that the robot faces
            points[:, still, -1] = start + np.stack([np.cos(headings), np.sin(headings)], axis=-1)[:, still]
        to_go = self.costs_to_go(inflated[:, 0], goals, points[:, :, -1])
        left, risk = _roll_out(to_go, inflated, lethal, points, layer)
        return left + self.settings.weight * self.longest_m * risk + cost

    def inflate(self, occupied: np.ndarray, fall: np.ndarray) -> np.ndarray:
        """Return the largest product of p and the weight of its distance around each pixel, (..., H, W)."""
        inflated = np.zeros_like(occupied)
        _spread(occupied.reshape(-1, *occupied.shape[-2:]), fall, inflated.reshape(-1, *occupied.shape[-2:]))
        return inflated

    def costs_to_go(self, inflated: np.ndarray, goals: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Compute the costs to goals [m], at least in the pixels around some points.

        Args:
            inflated: maps, (E, H, W).
            goals: x, y [m], (E, 2).
            ends: x, y [px], (E, A, 2).

        Returns:
            the costs, (E, H, W); infinite, or too large, farther away.
        """
        size = self.grid.size_px
        cost = (1 + self.settings.weight * inflated) * self.grid.resolution_m
        column, up = np.clip(goals // self.grid.resolution_m, 0, size - 1).astype(int).T
        nearby = np.stack([ends.min(1) - 1.5, ends.max(1) + 1.5], axis=1).clip(0, size - 1).astype(int)
        return _flood(cost, np.stack([size - 1 - up, column], axis=1), nearby, 0.999 * self.grid.resolution_m)


def arcs(commands: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Compute the points of arcs from the origin, heading along x [m], (A, P, 2).

    Args:
        commands: speed [m/s] and rate of turn [rad/s], (A, 2).
        times: times of the points [s], (P,).
    """
    speed, turn = commands[:, :1], commands[:, 1:]
    angle = turn * times / 2
    chord = speed * times * np.sinc(angle / np.pi)
    return np.stack([chord * np.cos(angle), chord * np.sin(angle)], axis=-1)


@compiled
def _spread(maps: np.ndarray, fall: np.ndarray, inflated: np.ndarray) -> None:
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
def _flood(cost: np.ndarray, goals: np.ndarray, nearby: np.ndarray, width: float) -> np.ndarray:
    """Compute the costs to goals with Dijkstra's algorithm and buckets (Dial 1969).

    A bucket has the pixels whose costs differ by less than the shortest edge, so that their order does not matter.

    Args:
        cost: of the way through each pixel, (E, H, W).
        goals: row and column, (E, 2).
        nearby: least and largest column and row from below of the pixels that are needed, (E, 2, 2).
        width: of a bucket.
    """
    size, beside = cost.shape[1], ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
    to_go = np.full(cost.shape, np.inf)
    buckets = int(1.5 * cost.max() / width) + 2  # that are in use at a time
    newest, pixels, before = (
        np.empty(buckets, np.int32),
        np.empty(9 * size**2, np.int32),
        np.empty(9 * size**2, np.int32),
    )
    settled = np.empty((size, size), np.bool_)
    for robot in range(len(cost)):
        newest[:], settled[:] = -1, False
        (left, low), (right, high) = nearby[robot]
        missing = (right - left + 1) * (high - low + 1)
        row, column = goals[robot]
        to_go[robot, row, column], newest[0], pixels[0], before[0], used, bucket = 0.0, 0, row * size + column, -1, 1, 0
        while missing:
            while newest[bucket % buckets] >= 0:
                entry = newest[bucket % buckets]
                newest[bucket % buckets] = before[entry]
                row, column = divmod(pixels[entry], size)
                if settled[row, column]:
                    continue
                settled[row, column] = True
                missing -= left <= column <= right and low <= size - 1 - row <= high
                own, so_far = cost[robot, row, column], to_go[robot, row, column]
                for down, across in beside:
                    to_row, to_column = row + down, column + across
                    if 0 <= to_row < size and 0 <= to_column < size and not settled[to_row, to_column]:
                        length = np.sqrt(2.0) if down and across else 1.0
                        found = so_far + 0.5 * (own + cost[robot, to_row, to_column]) * length
                        if found < to_go[robot, to_row, to_column]:
                            to_go[robot, to_row, to_column] = found
                            which = int(found / width) % buckets
                            pixels[used], before[used], newest[which] = to_row * size + to_column, newest[which], used
                            used += 1
            bucket += 1
    return to_go


@compiled
def _roll_out(
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


@compiled
def _unseen(
    age_s: np.ndarray, expected: np.ndarray, start: np.ndarray, points: np.ndarray, oldest_s: np.ndarray
) -> np.ndarray:
    """Return the obstacles that arcs meet unseen, a mean over their points, (E, A).

    Args:
        age_s: time since a beam passed over each pixel [s], (E, H, W).
        expected: obstacles that are expected in each pixel if it is unseen, (E, H, W).
        start: x, y of the robots [px], (E, 2), whose own pixel does not count.
        points: x, y [px], (E, A, P, 2).
        oldest_s: age up to which the pixel of each point is seen [s], (P,).
    """
    robots, number, steps = points.shape[:3]
    size, unseen = age_s.shape[1], np.zeros((robots, number))
    for robot, arc, step in np.ndindex((robots, number, steps)):
        x, y = points[robot, arc, step]
        is_own = int(x) == int(start[robot, 0]) and int(y) == int(start[robot, 1])
        if 0 <= x < size and 0 <= y < size and not is_own:
            pixel = robot, size - 1 - int(y), int(x)
            unseen[robot, arc] += expected[pixel] / steps if age_s[pixel] > oldest_s[step] else 0.0
    return unseen
