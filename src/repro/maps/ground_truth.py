"""True maps: rasterization of obstacle outlines and states, many maps at once, on the CPU or a GPU."""

import torch
from torch import Tensor

from repro.maps.grid import Grid


def rasterize(outlines: Tensor, states: Tensor, owner: Tensor, count: int, grid: Grid) -> Tensor:
    """Draw the true maps: a pixel is an obstacle if its center lies in one.

    In every row of pixels, the inside of a convex outline is one interval between the leftmost and the rightmost
    crossing of its edges with the center line of the row.

    Args:
        outlines: convex outlines of the obstacles of all maps in their own frame [m], (K, V, 2).
        states: obstacle poses x, y [m], heading [rad], (K, 3).
        owner: index of the map of each obstacle, (K,).
        count: number of maps, B.
        grid: grid of the maps.

    Returns:
        maps, uint8, (B, H, W); 1 is free, 0 is an obstacle.
    """
    # Outlines in the global frame, (K, V)
    cos, sin = torch.cos(states[:, 2:]), torch.sin(states[:, 2:])
    x = outlines[..., 0] * cos - outlines[..., 1] * sin + states[:, :1]
    y = outlines[..., 0] * sin + outlines[..., 1] * cos + states[:, 1:2]

    # Crossings of every edge with every row, (K, V, H)
    rows = grid.row_centers(x.device)
    x0, y0 = x[..., None], y[..., None]
    x1, y1 = x0.roll(-1, 1), y0.roll(-1, 1)
    crosses = (y0 <= rows) != (y1 <= rows)
    slope = (x1 - x0) / torch.where(y1 == y0, 1, y1 - y0)
    crossing = x0 + (rows - y0) * slope
    left = grid.first_column(torch.where(crosses, crossing, torch.inf).amin(1))  # (K, H)
    right = grid.first_column(torch.where(crosses, crossing, -torch.inf).amax(1)).maximum(left)

    # +1 where an interval begins, -1 where it ends; the cumulative sum counts the obstacles over a pixel
    stride = grid.size_px + 1
    line = (owner[:, None] * grid.size_px + torch.arange(grid.size_px, device=x.device)) * stride
    edges = torch.zeros(count * grid.size_px * stride, dtype=torch.int16, device=x.device)
    ones = torch.ones_like(line, dtype=torch.int16).flatten()
    edges.scatter_add_(0, (line + left).flatten(), ones).scatter_add_(0, (line + right).flatten(), -ones)
    cover = edges.view(count, grid.size_px, stride).cumsum(2, dtype=torch.int16)[..., :-1]
    return (cover == 0).to(torch.uint8)
