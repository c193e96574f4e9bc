"""The true maps of recordings."""

import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.recordings.format import ShardContent


def true_maps(shard: ShardContent, grid: Grid, device: torch.device | str = "cpu") -> Tensor:
    """Draw the true map of each recording at its last step, uint8, (R, H, W); 1 is free."""
    outlines, states, owner = (
        torch.as_tensor(array, device=device) for array in (shard.outlines, shard.states[:, -1], shard.world)
    )
    maps = rasterize(outlines, states, owner.long(), len(shard.scans) // 2, grid)
    return maps.repeat_interleave(2, dim=0)  # a world and its twin share their map
