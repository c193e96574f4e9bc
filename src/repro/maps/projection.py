"""Recording to images: the cumulative dynamic sensor projection, and the true map it is to be turned into.

Both take many runs at once, at any resolution, on the CPU or a GPU, and give uint8 images in which 0 is black.
"""

import torch
from torch import Tensor

from repro.maps.grid import Grid


def project(
    ranges: Tensor,
    angles: Tensor,
    poses: Tensor,
    grid: Grid,
    *,
    decay: bool = True,
    lightest: float = 0.8,
) -> Tensor:
    """Projects the scans of each run onto one gray-scale image.

    Every hit is placed in the global frame by pose and beam angle. The newest hit of a pixel wins. Of T steps,
    a hit of the last is black (0), one of the first has the gray `lightest`, those between lie on a straight
    line; the background is white (1).

    Paper: "Cumulative Dynamic Sensor Projection" and, for `decay=False`, "Ablation Study". The decay law is
    not stated: DEVIATIONS D7.

    Args:
        ranges: lidar ranges [m], (B, T, N); a miss is inf.
        angles: beam angles in the robot's frame [rad], (N,).
        poses: robot poses x, y [m], heading [rad], (B, T, 3).
        grid: where the pixels are.
        decay: False makes every hit equally black.
        lightest: gray of the oldest hit, in [0, 1).

    Returns:
        gray images, uint8, (B, H, W); darker is more recent.

    Raises:
        ValueError: the shapes disagree, or `lightest` is not in [0, 1).
    """
    if ranges.shape != (*poses.shape[:2], len(angles)) or poses.shape[-1] != 3:
        raise ValueError(
            "expected ranges (B, T, N), angles (N,), poses (B, T, 3), got "
            f"{tuple(ranges.shape)}, {tuple(angles.shape)}, {tuple(poses.shape)}"
        )
    if not 0 <= lightest < 1:
        raise ValueError(f"lightest must be in [0, 1), got {lightest}")
    batch, steps, _ = ranges.shape

    # Points in the global frame, (B, T, N, 2); misses go to infinity and so off the map
    heading = poses[..., 2:] + angles
    directions = torch.stack([torch.cos(heading), torch.sin(heading)], dim=-1)
    hit = torch.isfinite(ranges)
    points = poses[..., None, :2] + torch.where(hit, ranges, 0)[..., None] * directions
    index, inside = grid.pixels(points)

    # Newest step of each pixel, counted from 1; 0 is never hit
    age_rank = torch.arange(1, steps + 1, device=ranges.device)[:, None].expand_as(ranges)
    newest = torch.zeros(batch, grid.size_px**2, dtype=torch.long, device=ranges.device)
    newest.scatter_reduce_(1, index.flatten(1), torch.where(hit & inside, age_rank, 0).flatten(1), reduce="amax")
    return _shades(steps, decay, lightest, ranges.device)[newest].view(batch, grid.size_px, grid.size_px)


def _shades(steps: int, decay: bool, lightest: float, device: torch.device) -> Tensor:
    """Gray of a pixel by its newest step: white for none, then from the oldest to the newest, (T + 1,)."""
    shades = torch.zeros(steps + 1)
    if decay:
        shades[1:] = torch.linspace(lightest, 0, steps)
    shades[0] = 1
    return (255 * shades).round().to(torch.uint8).to(device)


def rasterize(outlines: Tensor, states: Tensor, run: Tensor, runs: int, grid: Grid) -> Tensor:
    """Draws the true maps: a pixel is an obstacle where its centre lies in one.

    In every row of pixels the inside of a convex outline is one interval, between the leftmost and the
    rightmost crossing of its edges with the row's centre line.

    Args:
        outlines: convex outlines in their own frame [m], (K, V, 2), for the obstacles of all runs together.
        states: obstacle poses x, y [m], heading [rad], (K, 3).
        run: which run each obstacle belongs to, (K,).
        runs: number of runs, B.
        grid: where the pixels are.

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

    # One up where an interval begins, one down where it ends; the running sum counts the obstacles over a pixel
    stride = grid.size_px + 1
    line = (run[:, None] * grid.size_px + torch.arange(grid.size_px, device=x.device)) * stride
    edges = torch.zeros(runs * grid.size_px * stride, dtype=torch.int16, device=x.device)
    ones = torch.ones_like(line, dtype=torch.int16).flatten()
    edges.scatter_add_(0, (line + left).flatten(), ones).scatter_add_(0, (line + right).flatten(), -ones)
    cover = edges.view(runs, grid.size_px, stride).cumsum(2, dtype=torch.int16)[..., :-1]
    return (cover == 0).to(torch.uint8)
