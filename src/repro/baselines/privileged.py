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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import shapely
import torch
from torch import Tensor

from repro.baselines.draws import count_cover, draw_ends, newest_hit, unseen
from repro.outlines import padded, placed
from repro.parallel import count_cores
from repro.recordings.format import SPLIT_SEEDS, SPLITS
from repro.recordings.recorded import Recorded, Truth
from repro.scans import wrapped
from repro.simulation.obstacle_motions import obstacle_states
from repro.simulation.shapes import geometry
from repro.simulation.worlds import sample_world
from repro.system.errors import InputError
from repro.system.progress import progress
from repro.world_config import Drifting, Sized, WorldSpec

DRAWS = 512  # of each obstacle
MOST_DRAWS = 64 * DRAWS  # tried of each obstacle
WORLDS = 2000  # sampled for the obstacles without a hit
FIRST_SEED = max(SPLITS.values()) + SPLIT_SEEDS  # no split has these worlds
LEAST_TURN_RAD = 0.01  # the stored positions are float32


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


def privileged(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predict the test recordings in threads; nothing is tuned on the validation set.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    assert test.truth, "the privileged predictor needs the true obstacles"
    if not test.truth.spec.is_like_papers:
        raise InputError(
            "needs worlds with one population of discs and rectangles that are static or drift, and the motion rotate "
            "or square, without fixed obstacles or noise of the lidar"
        )
    predict = partial(_predict, test, test.truth, _sampled(json.dumps(test.truth.spec.raw)))
    with ThreadPoolExecutor(count_cores()) as pool:  # compiled loops release the interpreter
        free = list(progress(pool.map(predict, range(len(test))), "drawing motions", total=len(test)))
    return torch.from_numpy(np.stack(free)).float()[:, None], {"draws": DRAWS}


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


def _predict(test: Recorded, truth: Truth, others: Obstacles, index: int) -> np.ndarray:
    """Compute the probability of free of one recording, (H, W)."""
    known, grid, scans = _turned(*truth.of_recording(index)), test.grid, test.scans
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
            ends = _ends(corners, path, last, (reached[last:], angles, poses[last:]), truth.spec, rng)
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
    assert isinstance(spec.obstacles, Sized), "see `WorldSpec.is_like_papers`"
    place, behavior = path[last - 1], spec.obstacles.behavior
    if behavior is None or not len(later[0]):
        return place[None]
    assert isinstance(behavior, Drifting), "see `WorldSpec.is_like_papers`"
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
