"""True maps of recordings, and a split with them: the input of baselines."""

from dataclasses import dataclass

import numpy as np

from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.maps.outlines import standing
from repro.recordings.format import ShardContent
from repro.recordings.reader import Recordings
from repro.scans import Scans


def true_maps(shard: ShardContent, grid: Grid, *, only_standing: bool = False) -> np.ndarray:
    """Draw the true map of each recording at its last step, uint8, (R, H, W); 1 is free.

    Args:
        only_standing: leave out obstacles that move during the recording.
    """
    kept = standing(shard.states) if only_standing else np.ones(len(shard.states), bool)
    outlines, states, owner = (array[kept] for array in (shard.outlines, shard.states[:, -1], shard.world))
    maps = rasterize(outlines, states, owner, len(shard.scans) // 2, grid)
    return np.repeat(maps, 2, axis=0)  # a world and its twin share their map


@dataclass(frozen=True)
class Recorded:
    """All recordings of one split with their true maps: the input of a baseline, which uses no images.

    Args:
        scans: ranges (M, T, N), angles (N,) and poses (M, T, 3), see `Scans.batched`.
        maps: true maps at the last step, uint8, (M, 1, H, W); 1 is free, 0 is an obstacle.
        grid: grid of the maps.
        range_max_m: maximum range of the lidar [m].
        step_s: duration of a time step [s].
        recordings: those that they are of, with the obstacles that no predictor from scans knows; None if of none.
    """

    scans: Scans
    maps: np.ndarray
    grid: Grid
    range_max_m: float
    step_s: float
    recordings: Recordings | None = None

    def __len__(self) -> int:
        return len(self.scans)


def load_recorded(recordings: Recordings, split: str, grid: Grid) -> Recorded:
    """Read the recordings of a split with their true maps.

    Raises:
        InputError: a shard fails verification, see `Recordings.shards`.
    """
    shards = list(recordings.shards(split))
    ranges, poses = (np.concatenate([getattr(shard.scans, name) for shard in shards]) for name in ("ranges", "poses"))
    maps = np.concatenate([true_maps(shard, grid) for shard in shards])[:, None]
    spec = recordings.spec
    scans = Scans(ranges, shards[0].scans.angles, poses).batched()
    return Recorded(scans, maps, grid, spec.lidar.range_max, spec.world.step_time, recordings)
