"""The laws of the paper's worlds, for predictors that know them: the worlds that have them, obstacles drawn by them."""

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import shapely
import torch
from torch import Tensor
from tqdm import tqdm

from repro.baselines.draws import count_cover
from repro.baselines.names import BOUNDS
from repro.maps.grid import Grid
from repro.outlines import padded, placed
from repro.parallel import count_cores
from repro.recordings.format import SPLIT_SEEDS, SPLITS
from repro.recordings.recorded import Recorded
from repro.simulation.motions import recorded_steps
from repro.simulation.obstacle_motions import obstacle_states
from repro.simulation.shapes import geometry
from repro.simulation.worlds import sample_world
from repro.system.errors import InputError
from repro.world_config import lidar_of

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


def applies(name: str, spec: dict[str, Any]) -> bool:
    """Return whether a baseline adds something in worlds of a spec."""
    if name == "mean_map":  # it predicts the fixed obstacles
        return bool(spec.get("fixed"))
    if name not in BOUNDS:
        return True
    needs_motion = name in ("without_velocities", "positions")  # where nothing moves, they equal those with velocities
    return knows(spec) and (not needs_motion or spec["obstacles"].get("behavior") is not None)


def knows(spec: dict[str, Any]) -> bool:
    """Return whether the laws of a world spec are those that these predictors draw from, the paper's."""
    is_exact = not lidar_of(spec).get("noise")
    has_zone = spec["motion"]["name"] in ("rotate", "square")
    if spec.get("fixed") or "radius_m" not in spec["obstacles"]:
        return False
    behavior = spec["obstacles"].get("behavior")
    return is_exact and has_zone and (behavior is None or behavior["name"] == "drift")


def check_laws(spec: dict[str, Any]) -> None:
    """Check that the laws of a world spec are known.

    Raises:
        ValueError: the worlds have other laws than the paper's.
    """
    if not knows(spec):
        raise InputError(
            "needs worlds with one population of discs and rectangles that are static or drift, and the motion rotate "
            "or square, without fixed obstacles or noise of the lidar"
        )


def sampled_obstacles(spec: dict[str, Any]) -> Obstacles:
    """Sample obstacles with their motions from other worlds of an experiment."""
    return _sampled(json.dumps(spec))


@cache
def _sampled(content: str) -> Obstacles:
    spec = json.loads(content)
    steps, step_s = recorded_steps(spec["motion"]), spec["world"]["step_time"]
    drawn = [each for number in range(WORLDS) for each in sample_world(spec, FIRST_SEED + number)["obstacle"]]
    outlines = [shapely.get_coordinates(geometry(each["shape"]))[None, :-1] for each in drawn]
    most = max(outline.shape[1] for outline in outlines)
    states = np.stack([obstacle_states(each, steps, step_s) for each in drawn])
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
        free = list(tqdm(drawn, desc=description, total=count, delay=2, leave=False, disable=None))
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
