"""An upper bound, and how it falls with less knowledge: predictors that know the true laws and some of the true states.

The scans tell less than the upper bound knows: of every obstacle that a beam has hit, its shape and its past up to the
last hit; of the others, their number. The rest it draws: the motion after the last hit from the law of `drift.Drift`,
obstacles without a hit from other sampled worlds. It keeps the draws that agree with the scans, those in which no beam
would have hit the obstacle, and of the obstacles without a hit those that start apart from the known ones. Given all
this the obstacles are independent of one another, so that a pixel is free with the product of their probabilities. Up
to the number of draws, no predictor from the scans has a lower expected log loss or Brier score.

`Knowledge` takes parts of this away, or adds the obstacles without a hit, to measure what each part is worth. A variant
that lacks a part can be worse than a network, since the scans tell something about every part. An obstacle of which no
draw agrees with the scans then stays where it was hit; the upper bound itself refuses such a case.

Not modeled: obstacles without a hit start apart from one another, and an obstacle may turn at its second step.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from torch import Tensor

from repro.baselines.draws import draw_ends, newest_hit, unseen
from repro.baselines.laws import (
    DRAWS,
    Obstacles,
    Scanned,
    check_laws,
    predict_each,
    sampled_obstacles,
    scans_of,
    share_covered,
    turned,
)
from repro.recordings.recorded import Recorded, Truth
from repro.scans import wrapped
from repro.system.errors import InputError
from repro.world_config import WorldSpec

MOST_DRAWS = 64 * DRAWS  # tried of each obstacle
LEAST_TURN_RAD = 0.01  # the stored positions are float32
CANDIDATES = 4096  # velocities of an obstacle whose velocity is not known


@dataclass(frozen=True)
class Knowledge:
    """What a predictor knows besides the laws, the number of obstacles, and where each was at its last hit.

    Args:
        shapes: the shapes of the obstacles that were hit; without, they are drawn from those of other worlds.
        velocities: their paths up to the last hit; without, their velocities are drawn from the law.
        unseen: the obstacles that no beam has hit.
    """

    shapes: bool = True
    velocities: bool = True
    unseen: bool = False


UPPER_BOUND = Knowledge()


def privileged(val: Recorded, test: Recorded, knowledge: Knowledge = UPPER_BOUND) -> tuple[Tensor, dict[str, Any]]:
    """Predict the test recordings; nothing is tuned on the validation set.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    assert test.truth, "the privileged predictor needs the true obstacles"
    check_laws(test.truth.spec)
    others = sampled_obstacles(test.truth.spec)
    predict = partial(_predict, test, test.truth, others, knowledge)
    return predict_each(predict, len(test), "drawing motions"), {"draws": DRAWS}


def _predict(test: Recorded, truth: Truth, others: Obstacles, knowledge: Knowledge, index: int) -> np.ndarray:
    """Compute the probability of free of one recording, (H, W)."""
    known = turned(*truth.of_recording(index))
    ranges, angles, poses = scans_of(test, index)
    obstacles = zip(known.corners, known.paths, strict=True)
    newest = np.array([newest_hit(*each, ranges, angles, poses) for each in obstacles])
    reached = np.where(np.isfinite(ranges), ranges, test.range_max_m)
    free = np.ones((test.grid.size_px, test.grid.size_px))
    rng = np.random.default_rng(index)
    for corners, path, last in zip(known.corners, known.paths, newest, strict=True):
        if last:
            outlines = corners[None] if knowledge.shapes else others.corners
            starts = _starts(corners, path, last, truth.spec, rng, knowledge)
            shapes, ends = _draw(outlines, starts, (reached[last:], angles, poses[last:]), truth.spec, rng, knowledge)
            free *= 1 - share_covered(shapes, ends, test.grid)
        elif knowledge.unseen:
            free *= 1 - share_covered(corners[None], path[-1:], test.grid)
    if 0 in newest and not knowledge.unseen:
        drawn = others
        if knowledge == UPPER_BOUND:
            drawn = _apart(others, Obstacles(known.corners[newest > 0], known.paths[newest > 0]))
        chosen = unseen(drawn.corners, drawn.paths, (reached, angles, poses), DRAWS)
        covered = share_covered(drawn.corners[chosen], drawn.paths[chosen, -1], test.grid)
        free *= (1 - covered) ** (newest == 0).sum()
    return free


def _apart(others: Obstacles, known: Obstacles) -> Obstacles:
    """Return those of other obstacles whose circles do not overlap those of known ones before the first step."""
    distance = np.linalg.norm(others.starts[:, None] - known.starts, axis=-1)
    is_apart = (distance >= others.radii[:, None] + known.radii).all(1)
    return Obstacles(others.corners[is_apart], others.paths[is_apart])


def _starts(
    corners: np.ndarray,
    path: np.ndarray,
    last: int,
    spec: WorldSpec,
    rng: np.random.Generator,
    knowledge: Knowledge,
) -> np.ndarray:
    """Return how an obstacle may move when it is last hit, see `draws.draw_ends`, (S, 5)."""
    behavior = check_laws(spec).behavior
    if behavior is None:
        return np.array([[*path[last - 1], 0.0, 0.0, 0.0]])
    least, longest = behavior.turn_steps
    if knowledge.velocities:
        keep_out_m = spec.clear_radius_m + np.linalg.norm(corners, axis=-1).max()
        velocity, straight = _motion(path[: max(last, 2)], spec.world.width / 2, keep_out_m, spec.world.step_time)
        return np.array([[*path[last - 1], *velocity, min(straight, longest)]])
    slowest, fastest = behavior.speed_m_s
    speed, bearing = rng.uniform(slowest, fastest, CANDIDATES), rng.uniform(-np.pi, np.pi, CANDIDATES)
    turns = rng.integers(least, longest + 1, (CANDIDATES, last // least + 1)).cumsum(1)
    since = last - np.where(turns <= last, turns, 0).max(1)
    place = np.tile(path[last - 1], (CANDIDATES, 1))
    return np.column_stack([place, speed * np.cos(bearing), speed * np.sin(bearing), since])


def _draw(
    outlines: np.ndarray,
    starts: np.ndarray,
    later: Scanned,
    spec: WorldSpec,
    rng: np.random.Generator,
    knowledge: Knowledge,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw outlines (K, V, 2) and ends [m], (K, 2), of an obstacle that agree with the scans after its last hit."""
    stands_still = not starts[:, 2:4].any()
    if len(outlines) == 1 and (stands_still or not len(later[0])):
        return outlines, starts[:1, :2]
    center_m, behavior = spec.world.width / 2, check_laws(spec).behavior
    turn_steps = behavior.turn_steps if behavior else (1, 1)
    motion = (spec.world.step_time, center_m, center_m, spec.clear_radius_m, *turn_steps)
    ends, which, tried = draw_ends(outlines, starts, motion, later, DRAWS, MOST_DRAWS, rng)
    if not len(ends):
        if knowledge == UPPER_BOUND:
            raise InputError(f"none of {tried} drawn motions of an obstacle agrees with the scans")
        return outlines[:DRAWS], np.repeat(starts[:1, :2], len(outlines[:DRAWS]), axis=0)  # it stays where it was hit
    return outlines[which], ends


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
