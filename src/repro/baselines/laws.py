"""The laws of the paper's worlds, for predictors that know them: the worlds that have them, obstacles drawn by them."""

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import shapely
import torch
from torch import Tensor

from repro.baselines.draws import count_cover
from repro.baselines.names import BOUNDS
from repro.maps.grid import Grid
from repro.outlines import padded, placed
from repro.parallel import count_cores
from repro.recordings.format import SPLIT_SEEDS, SPLITS
from repro.recordings.recorded import Recorded
from repro.simulation.obstacle_motions import obstacle_states
from repro.simulation.shapes import geometry
from repro.simulation.worlds import sample_world
from repro.system.errors import InputError
from repro.system.progress import progress
from repro.world_config import Sized, WorldSpec

DRAWS = 512  # of each obstacle
WORLDS = 2000  # sampled for the obstacles without a hit
FIRST_SEED = max(SPLITS.values()) + SPLIT_SEEDS  # no split has these worlds

Scanned = tuple[np.ndarray, np.ndarray, np.ndarray]  # ranges, angles and poses, see `draws.draw_ends`


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


def applies(name: str, spec: WorldSpec) -> bool:
    """Return whether a baseline adds something in worlds of a spec."""
    if name == "mean_map":  # it predicts the fixed obstacles
        return bool(spec.fixed)
    if name not in BOUNDS:
        return True
    needs_motion = name in ("without_velocities", "positions")  # where nothing moves, they equal those with velocities
    return knows(spec) and (not needs_motion or bool(spec.behaviors))


def knows(spec: WorldSpec) -> bool:
    """Return whether the laws of a world spec are those that these predictors draw from, the paper's."""
    drifts = all(behavior.name == "drift" for behavior in spec.behaviors)
    return isinstance(spec.obstacles, Sized) and drifts and not (spec.is_drive or spec.fixed or spec.lidar.noise)


def check_laws(spec: WorldSpec) -> Sized:
    """Return the population of a world spec after a check that its laws are known.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    if not knows(spec) or not isinstance(spec.obstacles, Sized):
        raise InputError(
            "needs worlds with one population of discs and rectangles that are static or drift, and the motion rotate "
            "or square, without fixed obstacles or noise of the lidar"
        )
    return spec.obstacles


def sampled_obstacles(spec: WorldSpec) -> Obstacles:
    """Sample obstacles with their motions from other worlds of an experiment."""
    return _sampled(json.dumps(spec.raw))


@cache
def _sampled(content: str) -> Obstacles:
    spec = WorldSpec.parse(json.loads(content))
    drawn = [each for number in range(WORLDS) for each in sample_world(spec, FIRST_SEED + number)["obstacle"]]
    outlines = [shapely.get_coordinates(geometry(each["shape"]))[None, :-1] for each in drawn]
    most = max(outline.shape[1] for outline in outlines)
    states = np.stack([obstacle_states(each, spec.steps, spec.world.step_time) for each in drawn])
    return turned(np.concatenate([padded(outline, most) for outline in outlines]), states)


def turned(outlines: np.ndarray, states: np.ndarray) -> Obstacles:
    """Turn outlines (K, V, 2) to the constant headings of their states (K, T, 3)."""
    at_origin = states[:, 0].astype(np.float64) * [0, 0, 1]
    corners = placed(outlines.astype(np.float64), at_origin)
    return Obstacles(corners, np.ascontiguousarray(states[..., :2], dtype=np.float64))


def predict_each(predict: Callable[[int], np.ndarray], count: int, description: str) -> Tensor:
    """Predict recordings 0 to M - 1 in threads; return the probability of free, (M, 1, H, W).

    Args:
        predict: function from the index of a recording to its probability of free, (H, W); its compiled loops release
            the interpreter.
        count: number of recordings, M.
        description: of the progress bar.
    """
    with ThreadPoolExecutor(count_cores()) as pool:
        drawn = pool.map(predict, range(count))
        free = list(progress(drawn, description, total=count))
    return torch.from_numpy(np.stack(free)).float()[:, None]


def scans_of(recorded: Recorded, index: int) -> Scanned:
    """Return ranges, inf for a miss, angles and poses of a recording in double precision."""
    scans = recorded.scans
    ranges, angles, poses = (
        np.ascontiguousarray(part, dtype=np.float64) for part in (scans.ranges[index], scans.angles, scans.poses[index])
    )
    return ranges, angles, poses


def share_covered(corners: np.ndarray, ends: np.ndarray, grid: Grid) -> np.ndarray:
    """Compute the share of draws, outlines (K, V, 2) at ends (K, 2) [m], that cover each pixel, (H, W)."""
    return count_cover(corners, ends, grid.size_px, grid.size_m) / max(len(ends), 1)
