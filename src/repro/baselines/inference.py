"""What scans alone tell: a predictor that knows the laws of the paper's worlds and infers the obstacles from the scans.

The hits of a recording are explained by obstacles (`association`), whose particles give the probability that a pixel
is covered. Obstacles without a hit are drawn from other worlds, as for the upper bound, and their number from the law
given those that were found.

In expected log loss and Brier score, the best prediction from scans lies between this one and the upper bound. This one
is no bound: it decides which hits belong together, and lets obstacles overlap at the start. The upper bound knows more
than the scans tell.
"""

import math
from functools import partial
from typing import Any

import numpy as np
from scipy.special import comb
from torch import Tensor

from repro.baselines import association
from repro.baselines import particles as model
from repro.baselines.association import Inferred, Seen, explain, observe
from repro.baselines.draws import unseen
from repro.baselines.laws import (
    DRAWS,
    Obstacles,
    Scanned,
    check_laws,
    predict_each,
    sampled_obstacles,
    scans_of,
    share_covered,
)
from repro.maps.grid import Grid
from repro.recordings.recorded import Recorded
from repro.system.errors import InputError
from repro.world_config import WorldSpec

CORNERS = 64  # of a disc, as in the simulation


def infer(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predict the test recordings from their scans; nothing is tuned on the validation set.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    assert test.truth, "the predictor needs the laws of the worlds"
    spec = test.truth.spec
    _check_window(test, spec)
    others = sampled_obstacles(spec)
    free = predict_each(partial(_predict, test, spec, others), len(test), "inferring obstacles")
    return free, {"particles": association.PARTICLES}


def _check_window(test: Recorded, spec: WorldSpec) -> None:
    behavior, steps = check_laws(spec).behavior, test.scans.ranges.shape[1]
    if behavior and 2 * behavior.turn_steps[0] < steps:
        raise InputError(
            f"the inference takes one random turn in {steps} steps: expected turn_steps of at least "
            f"{math.ceil(steps / 2)}, got {list(behavior.turn_steps)}"
        )
    if float(test.scans.angles.abs().max()) >= math.pi / 2:
        raise InputError("the inference takes a field of view of less than 180 degrees")


def _predict(test: Recorded, spec: WorldSpec, others: Obstacles, index: int) -> np.ndarray:
    """Compute the probability of free of one recording, (H, W)."""
    ranges, angles, poses = scans_of(test, index)
    seen = observe((ranges, angles, poses), test.range_max_m, spec, np.random.default_rng(index))
    found = explain(seen)
    free = np.ones((test.grid.size_px, test.grid.size_px))
    for each in found:
        free *= 1 - share_covered(*_ends(each, seen), test.grid)
    return free * _free_of_unseen(others, (seen.scans[0], angles, poses), spec, len(found), test.grid)


def _ends(each: Inferred, seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    """Return outlines around their origins (K, V, 2) and positions at the last step (K, 2) of particles [m]."""
    turn = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]] + [[1.0, -1.0]] * (CORNERS - 3))
    corners = np.empty((len(each.particles), CORNERS, 2))
    for own, particle in zip(corners, each.particles, strict=True):
        is_disc, length, width, cos, sin, _ = model.shape(particle)
        own[:] = (circle if is_disc else square) * [length, width] @ np.array([[cos, sin], [-sin, cos]])
    motion, steps = seen.motion(each.reference), len(seen.scans[0])
    return corners, np.stack([model.path(particle, motion, steps)[-1] for particle in each.particles])


def _free_of_unseen(others: Obstacles, scanned: Scanned, spec: WorldSpec, found: int, grid: Grid) -> np.ndarray:
    """Compute the probability that no obstacle without a hit covers a pixel, given how many were found, (H, W)."""
    drawn = unseen(others.corners, others.paths, scanned, len(others.corners))
    if not len(drawn):
        return np.ones((grid.size_px, grid.size_px))
    least, most = check_laws(spec).count
    missing = np.arange(max(least - found, 0), max(most - found, 0) + 1)
    weights = comb(found + missing, found) * (len(drawn) / len(others.corners)) ** missing
    covered = share_covered(others.corners[drawn[:DRAWS]], others.paths[drawn[:DRAWS], -1], grid)
    return np.average((1 - covered)[..., None] ** missing, axis=-1, weights=weights)
