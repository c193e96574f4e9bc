"""An upper bound: a predictor that knows the true state of every obstacle at its last hit, and the true laws.

The scans tell less than this predictor knows: of every obstacle that a beam has hit, its shape and its past up to the
last hit; of the others, their number. The rest it draws: the motion after the last hit from the law of `drift.Drift`,
obstacles without a hit from other sampled worlds. It keeps the draws that agree with the scans, those in which no beam
would have hit the obstacle. Given all this the obstacles are independent of one another, so that a pixel is free with
the product of their probabilities. Up to the number of draws, no predictor from the scans has a lower expected log loss
or Brier score.

Not modeled: obstacles without a hit do not overlap others at the start.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import torch
from torch import Tensor
from tqdm import tqdm

from repro.baselines.draws import count_cover, draw_ends, newest_hit, unseen
from repro.maps.datasets import Recorded, Truth
from repro.maps.grid import Grid
from repro.recordings.format import SPLIT_SEEDS, SPLITS, widen
from repro.simulation.drift import obstacle_states
from repro.simulation.motions import recorded_steps
from repro.simulation.shapes import geometry
from repro.simulation.worlds import sample_world

DRAWS = 512  # kept of each obstacle
MOST_DRAWS = 64 * DRAWS  # tried of each obstacle
WORLDS = 2000  # sampled for the obstacles without a hit
FIRST_SEED = max(SPLITS.values()) + SPLIT_SEEDS  # no split has these worlds
LEAST_TURN_RAD = 0.01  # the stored positions are float32

Scanned = tuple[np.ndarray, np.ndarray, np.ndarray]  # ranges, angles and poses, see `draws.draw_ends`


@dataclass(frozen=True)
class Obstacles:
    """Obstacles with constant headings: outlines around their origins [m], (K, V, 2), and positions [m], (K, T, 2)."""

    corners: np.ndarray
    paths: np.ndarray


def knows(spec: dict[str, Any]) -> bool:
    """Return whether the laws of a world spec are those that this predictor draws from, the paper's."""
    is_exact = not spec["robot"]["sensors"][0].get("noise")
    has_zone = spec["motion"]["name"] in ("rotate", "square")
    return is_exact and has_zone and not spec.get("fixed") and "radius_m" in spec["obstacles"]


def privileged(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predict the test recordings; nothing is tuned on the validation set.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    assert test.truth, "the privileged predictor needs the true obstacles"
    if not knows(test.truth.spec):
        raise ValueError("the upper bound draws from the paper's laws: no walls, noise, drives or several populations")
    others = _sampled_obstacles(test.truth.spec)
    indices = tqdm(range(len(test)), desc="drawing motions", delay=2, leave=False, disable=None)
    free = [_predict(test, test.truth, index, others) for index in indices]
    return torch.from_numpy(np.stack(free)).float()[:, None], {"draws": DRAWS}


def _predict(test: Recorded, truth: Truth, index: int, others: Obstacles) -> np.ndarray:
    """Compute the probability of free of one recording, (H, W)."""
    known = _obstacles(*truth.of_recording(index))
    parts = (test.scans.ranges[index], test.scans.angles, test.scans.poses[index])
    ranges, angles, poses = (np.ascontiguousarray(part, dtype=np.float64) for part in parts)
    newest = [newest_hit(*each, ranges, angles, poses) for each in zip(known.corners, known.paths, strict=True)]
    reached = np.where(np.isfinite(ranges), ranges, test.range_max_m)
    free = np.ones((test.grid.size_px, test.grid.size_px))
    for corners, path, last in zip(known.corners, known.paths, newest, strict=True):
        if last:
            later = (reached[last:], angles, poses[last:])
            free *= 1 - _share_covered(
                corners[None], _ends(corners, path, last, later, truth.spec, seed=index), test.grid
            )
    if 0 in newest:
        drawn = unseen(others.corners, others.paths, (reached, angles, poses), DRAWS)
        covered = _share_covered(others.corners[drawn], others.paths[drawn, -1], test.grid)
        free *= (1 - covered) ** newest.count(0)
    return free


def _ends(
    corners: np.ndarray, path: np.ndarray, last: int, later: Scanned, spec: dict[str, Any], seed: int
) -> np.ndarray:
    """Draw where an obstacle that was last hit at step `last` is at the end [m], (K, 2)."""
    behavior, step_s = spec["obstacles"].get("behavior"), spec["world"]["step_time"]
    if behavior is None or last == len(path):
        return path[-1:]
    center_m = spec["world"]["width"] / 2
    keep_out_m = spec["clear_radius_m"] + np.linalg.norm(corners, axis=-1).max()
    velocity, straight = _motion(path[: max(last, 2)], center_m, keep_out_m, step_s)
    least, longest = behavior["turn_steps"]
    start = np.array([*path[last - 1], *velocity, min(straight, longest)])
    law = (step_s, center_m, center_m, keep_out_m, least, longest)
    ends, tried = draw_ends(corners, start, law, later, DRAWS, MOST_DRAWS, np.random.default_rng(seed))
    if not len(ends):
        raise ValueError(f"none of {tried} drawn motions of an obstacle agrees with the scans of recording {seed}")
    return ends


def _motion(path: np.ndarray, center_m: float, keep_out_m: float, step_s: float) -> tuple[np.ndarray, int]:
    """Return the last velocity of a path (T, 2) [m/s], (2,), and the number of steps since the last random turn."""
    moves = np.diff(path, axis=0)
    bearing = np.arctan2(moves[:, 1], moves[:, 0])
    turns = np.flatnonzero(np.abs(np.angle(np.exp(1j * np.diff(bearing)))) > LEAST_TURN_RAD) + 1  # indices of moves
    away = path[turns] - center_m
    ahead = np.linalg.norm(away + moves[turns - 1], axis=1)
    at_zone = (ahead < keep_out_m) & ((away * moves[turns - 1]).sum(1) < 0)  # such a turn does not count
    random = turns[~at_zone]
    return moves[-1] / step_s, int(len(path) - 1 - random[-1]) if len(random) else len(path)


def _sampled_obstacles(spec: dict[str, Any]) -> Obstacles:
    """Sample obstacles with their motions from other worlds of an experiment."""
    steps, step_s = recorded_steps(spec["motion"]), spec["world"]["step_time"]
    drawn = [each for number in range(WORLDS) for each in sample_world(spec, FIRST_SEED + number)["obstacle"]]
    outlines = [shapely.get_coordinates(geometry(each["shape"]))[None, :-1] for each in drawn]
    most = max(outline.shape[1] for outline in outlines)
    states = np.stack([obstacle_states(each, steps, step_s) for each in drawn])
    return _obstacles(np.concatenate([widen(outline, most) for outline in outlines]), states)


def _obstacles(outlines: np.ndarray, states: np.ndarray) -> Obstacles:
    """Turn outlines (K, V, 2) to the constant headings of their states (K, T, 3)."""
    cos, sin = (turn(states[:, 0, 2].astype(np.float64))[:, None] for turn in (np.cos, np.sin))
    x, y = outlines[..., 0].astype(np.float64), outlines[..., 1].astype(np.float64)
    corners = np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1)
    return Obstacles(corners, np.ascontiguousarray(states[..., :2], dtype=np.float64))


def _share_covered(corners: np.ndarray, ends: np.ndarray, grid: Grid) -> np.ndarray:
    """Compute the share of the draws that cover each pixel, (H, W)."""
    return count_cover(corners, ends, grid.size_px, grid.size_m) / max(len(ends), 1)
