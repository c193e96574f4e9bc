"""The true maps of recordings."""

import math

import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.recordings.format import ShardContent

_RAYS = 720  # one every half degree, a pixel apart at 22 m for one of 0.2 m
_AT_ONCE = 20  # maps, whose rays are in memory


def true_maps(shard: ShardContent, grid: Grid, device: torch.device | str = "cpu") -> Tensor:
    """Draw the true map of each recording at its last step, uint8, (R, H, W); 1 is free."""
    outlines, states, owner = (
        torch.as_tensor(array, device=device) for array in (shard.outlines, shard.states[:, -1], shard.world)
    )
    maps = rasterize(outlines, states, owner.long(), len(shard.scans) // 2, grid)
    return maps.repeat_interleave(2, dim=0)  # a world and its twin share their map


def shown_pixels(maps: Tensor, poses: Tensor, grid: Grid) -> Tensor:
    """Return the pixels that a lidar of 360 degrees would show: those before the first obstacle of a ray, and this one.

    Args:
        maps: true maps, uint8, (B, H, W); 1 is free.
        poses: poses of the lidars x, y [m], heading [rad], (B, 3).
        grid: grid of the maps.

    Returns:
        whether each pixel is shown, bool, (B, H, W).
    """
    bearings = torch.arange(_RAYS, device=maps.device) * (2 * math.pi / _RAYS)
    reach_m = math.sqrt(2) * grid.size_m
    distances = torch.arange(0, reach_m, grid.resolution_m / 2, device=maps.device)
    ways = torch.stack([bearings.cos(), bearings.sin()], -1)[:, None] * distances[:, None]  # (rays, samples, 2)
    shown = torch.zeros_like(maps, dtype=torch.uint8).flatten(1)
    for part in torch.arange(len(maps), device=maps.device).split(_AT_ONCE):
        pixels, inside = grid.pixels(poses[part, None, None, :2] + ways)
        blocks = (maps[part].flatten(1).gather(1, pixels.flatten(1)).view_as(pixels) == 0) & inside
        before = blocks.cumsum(-1, dtype=torch.int16) - blocks.to(torch.int16)
        shown[part] = shown[part].scatter_reduce(
            1, pixels.flatten(1), ((before == 0) & inside).to(torch.uint8).flatten(1), reduce="amax"
        )
    return shown.view_as(maps).bool()
