"""Statistics of a recorded experiment: map area covered by obstacles, obstacle area that the lidar hits."""

import numpy as np

from repro.evaluation.recency import obstacle_masks
from repro.maps.grid import Grid
from repro.recordings.reader import Recordings
from repro.recordings.recorded import true_maps
from repro.system.errors import InputError


def coverage_and_visibility(recordings: Recordings, split: str, grid: Grid) -> dict[str, float]:
    """Measure coverage and visibility of a split, for comparison with the values that the paper's tables imply.

    Args:
        split: train, val or test.
        grid: grid on which areas are counted.

    Returns:
        `coverage`, the mean share of the map that obstacles cover at the last step, and `visibility`, the share of
        the obstacle area that belongs to obstacles hit at least once, which the specificity of a predictor that marks
        only these cannot exceed.

    Raises:
        InputError: no obstacle of the split covers the center of a pixel.
    """
    covered_px = maps_px = seen_px = all_px = 0.0
    for shard in recordings.shards(split):
        free = true_maps(shard, grid)[::2]  # a world and its twin share their map
        covered_px += (1 - free).sum(dtype=int)
        maps_px += free.size
        area = obstacle_masks(shard, grid).sum((1, 2))
        rank = np.arange(len(area)) - np.searchsorted(shard.world, shard.world)  # index of an obstacle in its world
        for twin in (0, 1):
            seen_px += area[shard.seen[2 * shard.world + twin, rank]].sum()
            all_px += area.sum()
    if not all_px:
        raise InputError(
            f"no obstacle of {split} covers the center of a pixel: expected obstacles larger than the pixels, "
            f"which are {grid.resolution_m:.2f} m wide; enlarge the obstacles or scale.size_px (now {grid.size_px})"
        )
    return {"coverage": covered_px / maps_px, "visibility": float(seen_px / all_px)}
