"""An upper bound: a predictor that knows the true laws of the worlds and some of their true states.

The scans tell less than the upper bound knows: of every obstacle that a beam has hit, its shape and its past up to the
last hit; of the others, their number. The rest it draws: the motion after the last hit from the law of `drift.Drift`,
obstacles without a hit from other sampled worlds. It keeps the draws that agree with the scans, those in which no beam
would have hit the obstacle, and of the obstacles without a hit those that start apart from the known ones. Given all
this the obstacles are independent of one another, so that a pixel is free with the product of their probabilities. Up
to the number of draws, no predictor from the scans has a lower expected log loss or Brier score.

Not modeled: obstacles without a hit start apart from one another, and an obstacle may turn at its second step.
"""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import shapely

from repro.maps.outlines import padded, placed
from repro.recordings.format import SPLIT_SEEDS, SPLITS
from repro.recordings.recorded import Recorded
from repro.runs.parallel import count_cores
from repro.scans import wrapped
from repro.simulation.sampling import sample_world
from repro.simulation.shapes import geometry
from repro.system.compiled import compiled
from repro.system.errors import InputError
from repro.system.progress import progress
from repro.worlds.obstacle_motions import Drifting, obstacle_states
from repro.worlds.obstacles import Sized
from repro.worlds.spec import WorldSpec

DRAWS = 512  # of each obstacle
MOST_DRAWS = 64 * DRAWS  # tried of each obstacle
WORLDS = 2000  # sampled for the obstacles without a hit
FIRST_SEED = max(SPLITS.values()) + SPLIT_SEEDS  # no split has these worlds
LEAST_TURN_RAD = 0.01  # the stored positions are float32
TOLERANCE_M = 0.02  # a beam that enters an obstacle by less than this may have ended on it; ranges are float32


@dataclass(frozen=True)
class Obstacles:
    """Obstacles with constant headings: outlines around their origins [m], (K, V, 2), and positions [m], (K, T, 2)."""

    corners: np.ndarray
    paths: np.ndarray

    @cached_property
    def radii(self) -> np.ndarray:
        """Radii of the circles around the outlines [m], (K,)."""
        return np.linalg.norm(self.corners, axis=-1).max(1)

    @cached_property
    def starts(self) -> np.ndarray:
        """Positions before the first step [m], (K, 2), extrapolated from the first two steps."""
        return 2 * self.paths[:, 0] - self.paths[:, 1]


def privileged(val: Recorded, test: Recorded) -> tuple[np.ndarray, dict[str, Any]]:
    """Predict the test recordings in threads; nothing is tuned on the validation set.

    Raises:
        InputError: the worlds have other laws than the paper's.
    """
    assert test.recordings, "the privileged predictor needs the true obstacles"
    spec = test.recordings.spec
    drifts = isinstance(spec.obstacles, Sized) and all(behavior.name == "drift" for behavior in spec.behaviors)
    if not drifts or spec.is_drive or spec.fixed or spec.lidar.noise or spec.sensing:
        raise InputError(
            "needs worlds with one population of discs and rectangles that are static or drift, and the motion rotate "
            "or square, without fixed obstacles or noise of the lidar"
        )
    known = [
        _turned(shard.outlines[shard.world == world], shard.states[shard.world == world])
        for shard in test.recordings.shards("test")
        for world in range(len(shard.scans) // 2)
    ]
    predict = partial(_predict, test, spec, _sampled(json.dumps(spec.raw)))
    with ThreadPoolExecutor(count_cores()) as pool:  # compiled loops release the interpreter
        drawn = pool.map(predict, [each for each in known for _ in (0, 1)], range(len(test)))
        free = list(progress(drawn, "drawing motions", total=len(test)))
    return np.stack(free).astype(np.float32)[:, None], {"draws": DRAWS}


@cache
def _sampled(content: str) -> Obstacles:
    """Sample obstacles with their motions from other worlds of an experiment, given the JSON of its spec."""
    spec = WorldSpec.parse(json.loads(content))
    drawn = [each for number in range(WORLDS) for each in sample_world(spec, FIRST_SEED + number)["obstacle"]]
    outlines = [shapely.get_coordinates(geometry(each["shape"]))[None, :-1] for each in drawn]
    most = max(outline.shape[1] for outline in outlines)
    states = np.stack([obstacle_states(each, spec.steps, spec.world.step_time) for each in drawn])
    return _turned(np.concatenate([padded(outline, most) for outline in outlines]), states)


def _turned(outlines: np.ndarray, states: np.ndarray) -> Obstacles:
    """Turn outlines (K, V, 2) to the constant headings of their states (K, T, 3)."""
    at_origin = states[:, 0].astype(np.float64) * [0, 0, 1]
    corners = placed(outlines.astype(np.float64), at_origin)
    return Obstacles(corners, np.ascontiguousarray(states[..., :2], dtype=np.float64))


def _predict(test: Recorded, spec: WorldSpec, others: Obstacles, known: Obstacles, index: int) -> np.ndarray:
    """Compute the probability of free of one recording with known obstacles, (H, W)."""
    grid, scans = test.grid, test.scans
    ranges, angles, poses = (
        np.ascontiguousarray(part, dtype=np.float64) for part in (scans.ranges[index], scans.angles, scans.poses[index])
    )
    obstacles = zip(known.corners, known.paths, strict=True)
    newest = np.array([newest_hit(*each, ranges, angles, poses) for each in obstacles])
    reached = np.where(np.isfinite(ranges), ranges, test.range_max_m)

    def covered(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Compute the share of draws, outlines (K, V, 2) at ends (K, 2) [m], that cover each pixel, (H, W)."""
        return count_cover(corners, ends, grid.size_px, grid.size_m) / max(len(ends), 1)

    free = np.ones((grid.size_px, grid.size_px))
    rng = np.random.default_rng(index)
    for corners, path, last in zip(known.corners, known.paths, newest, strict=True):
        if last:
            ends = _ends(corners, path, last, (reached[last:], angles, poses[last:]), spec, rng)
            free *= 1 - covered(corners[None], ends)
    if 0 in newest:
        drawn = _apart(others, Obstacles(known.corners[newest > 0], known.paths[newest > 0]))
        chosen = unseen(drawn.corners, drawn.paths, (reached, angles, poses), DRAWS)
        free *= (1 - covered(drawn.corners[chosen], drawn.paths[chosen, -1])) ** (newest == 0).sum()
    return free


def _apart(others: Obstacles, known: Obstacles) -> Obstacles:
    """Return those of other obstacles whose circles do not overlap those of known ones before the first step."""
    distance = np.linalg.norm(others.starts[:, None] - known.starts, axis=-1)
    is_apart = (distance >= others.radii[:, None] + known.radii).all(1)
    return Obstacles(others.corners[is_apart], others.paths[is_apart])


def _ends(
    corners: np.ndarray,
    path: np.ndarray,
    last: int,
    later: tuple[np.ndarray, np.ndarray, np.ndarray],
    spec: WorldSpec,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draw ends [m], (K, 2), of an obstacle that was last hit at a step, which agree with the later scans."""
    assert isinstance(spec.obstacles, Sized), "see `privileged`"
    place, behavior = path[last - 1], spec.obstacles.behavior
    if behavior is None or not len(later[0]):
        return place[None]
    assert isinstance(behavior, Drifting), "see `privileged`"
    center_m, step_s, clear_m = spec.world.width / 2, spec.world.step_time, spec.clear_radius_m
    keep_out_m = clear_m + np.linalg.norm(corners, axis=-1).max()
    velocity, straight = _motion(path[: max(last, 2)], center_m, keep_out_m, step_s)
    start = np.array([*place, *velocity, min(straight, behavior.turn_steps[1])])
    law = (step_s, center_m, center_m, clear_m, *behavior.turn_steps)
    ends, tried = draw_ends(corners, start, law, later, DRAWS, MOST_DRAWS, rng)
    if not len(ends):
        raise InputError(f"none of {tried} drawn motions of an obstacle agrees with the scans")
    return ends


def _motion(path: np.ndarray, center_m: float, keep_out_m: float, step_s: float) -> tuple[np.ndarray, int]:
    """Return the last velocity of a path (T, 2) [m/s], (2,), and the number of steps since the last random turn."""
    moves = np.diff(path, axis=0)
    bearing = np.arctan2(moves[:, 1], moves[:, 0])
    turns = np.flatnonzero(np.abs(wrapped(np.diff(bearing))) > LEAST_TURN_RAD) + 1  # indices of moves
    away = path[turns] - center_m
    ahead = np.linalg.norm(away + moves[turns - 1], axis=1)
    at_zone = (ahead < keep_out_m) & ((away * moves[turns - 1]).sum(1) < 0)  # such a turn does not count
    random = turns[~at_zone]
    return moves[-1] / step_s, int(len(path) - 1 - random[-1]) if len(random) else len(path)


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
    for ahead in (bearing - turn, bearing - turn + 2 * math.pi):
        first = max(0, math.ceil((ahead - half - angles[0]) / spacing))
        last = min(len(angles) - 1, math.floor((ahead + half - angles[0]) / spacing))
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
