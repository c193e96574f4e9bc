"""True maps: rasterization of obstacle outlines and states, many maps at once, on the CPU or a GPU."""

import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.outlines import placed

LINE, CONVEX, CONCAVE = 0, 1, 2  # kinds of outlines
AT_ONCE = 100  # outlines, whose crossings with every row are in memory
_SMALL = 1e-9  # of the squared size of an outline: an area below is rounding


def rasterize(outlines: Tensor, states: Tensor, owner: Tensor, count: int, grid: Grid) -> Tensor:
    """Draw the true maps: a pixel is an obstacle if its center lies in one, or if a line passes through it.

    In every row of pixels, the inside of a convex outline is one interval between the leftmost and the rightmost
    crossing of its edges with the center line of the row. The inside of another outline begins and ends at each
    crossing, where the winding number changes. An outline without area is a line string.

    Args:
        outlines: outlines of the obstacles of all maps in their own frame [m], (K, V, 2).
        states: obstacle poses x, y [m], heading [rad], (K, 3).
        owner: index of the map of each obstacle, (K,).
        count: number of maps, B.
        grid: grid of the maps.

    Returns:
        maps, uint8, (B, H, W); 1 is free, 0 is an obstacle.
    """
    x, y = placed(outlines, states).unbind(-1)  # (K, V)

    # +1 where an interval begins, -1 where it ends; the cumulative sum counts the obstacles over a pixel
    stride = grid.size_px + 1
    edges = torch.zeros(count * grid.size_px * stride, dtype=torch.int16, device=x.device)
    kinds = kinds_of(outlines)
    for kind, intervals in ((CONVEX, _of_convex), (CONCAVE, _of_concave), (LINE, _of_line)):
        for chosen in (kinds == kind).nonzero()[:, 0].split(AT_ONCE):
            rows = (owner[chosen, None] * grid.size_px + torch.arange(grid.size_px, device=x.device)) * stride
            left, right, sign = intervals(x[chosen], y[chosen], grid)  # (K, H) or (K, V, H)
            start = rows if left.dim() == 2 else rows[:, None]
            edges.scatter_add_(0, (start + left).flatten(), sign.flatten())
            edges.scatter_add_(0, (start + right).flatten(), -sign.flatten())
    cover = edges.view(count, grid.size_px, stride).cumsum(2, dtype=torch.int16)[..., :-1]
    return (cover == 0).to(torch.uint8)


def kinds_of(outlines: Tensor) -> Tensor:
    """Return the kind of each outline (K, V, 2), (K,): LINE there and back, CONVEX, or neither."""
    own = outlines.double()
    own = own - own[:, :1]
    x, y = own.unbind(-1)
    edge_x, edge_y = x.roll(-1, 1) - x, y.roll(-1, 1) - y
    size = own.square().sum(-1).amax(1)
    area = (x * edge_y - y * edge_x).sum(1).abs()
    least, most = torch.zeros_like(area), torch.zeros_like(area)
    for corner in range(outlines.shape[1]):  # the side of every edge on which it lies
        side = edge_x * (y[:, corner, None] - y) - edge_y * (x[:, corner, None] - x)
        least, most = least.minimum(side.amin(1)), most.maximum(side.amax(1))
    bends = torch.minimum(-least, most) > 1e-6 * size  # outlines are stored with 24 bits
    kinds = torch.where(bends, CONCAVE, CONVEX)
    return torch.where(area <= _SMALL * size, LINE, kinds)


def _crossings(x: Tensor, y: Tensor, grid: Grid) -> tuple[Tensor, Tensor, Tensor]:
    """Return where every edge crosses the center line of every row, whether it does, and whether upward, (K, V, H)."""
    rows = grid.row_centers(x.device)
    x0, y0 = x[..., None], y[..., None]
    x1, y1 = x0.roll(-1, 1), y0.roll(-1, 1)
    crosses = (y0 <= rows) != (y1 <= rows)
    slope = (x1 - x0) / torch.where(y1 == y0, 1, y1 - y0)
    return x0 + (rows - y0) * slope, crosses, (y1 > y0).expand_as(crosses)


def _of_convex(x: Tensor, y: Tensor, grid: Grid) -> tuple[Tensor, Tensor, Tensor]:
    crossing, crosses, _ = _crossings(x, y, grid)
    left = grid.first_column(torch.where(crosses, crossing, torch.inf).amin(1))  # (K, H)
    right = grid.first_column(torch.where(crosses, crossing, -torch.inf).amax(1)).maximum(left)
    return left, right, torch.ones_like(left, dtype=torch.int16)


def _of_concave(x: Tensor, y: Tensor, grid: Grid) -> tuple[Tensor, Tensor, Tensor]:
    """Return an interval from every crossing to the end of the row; the signs add up to 1 inside and 0 outside."""
    crossing, crosses, is_upward = _crossings(x, y, grid)
    x, y = x - x[:, :1], y - y[:, :1]
    area = (x * y.roll(-1, 1) - y * x.roll(-1, 1)).sum(1)  # positive if counter-clockwise: the left edges go down
    sign = torch.where(is_upward, -1, 1) * torch.sign(area).int()[:, None, None]
    left = grid.first_column(torch.where(crosses, crossing, torch.inf))
    return left, torch.full_like(left, grid.size_px), torch.where(crosses, sign, 0).to(torch.int16)


def _of_line(x: Tensor, y: Tensor, grid: Grid) -> tuple[Tensor, Tensor, Tensor]:
    """Return the pixels of every row through which each segment passes, as intervals (K, V, H)."""
    half = grid.resolution_m / 2
    rows = grid.row_centers(x.device)
    x0, y0 = x[..., None], y[..., None]
    x1, y1 = x0.roll(-1, 1), y0.roll(-1, 1)
    touches = (torch.maximum(y0, y1) >= rows - half) & (torch.minimum(y0, y1) < rows + half)
    slope = (x1 - x0) / torch.where(y1 == y0, 1, y1 - y0)
    low, high = torch.minimum(y0, y1).maximum(rows - half), torch.maximum(y0, y1).minimum(rows + half)
    is_level = y1 == y0
    a = torch.where(is_level, x0, x0 + (low - y0) * slope)
    b = torch.where(is_level, x1, x0 + (high - y0) * slope)
    left = torch.floor(torch.minimum(a, b) / grid.resolution_m).clamp(0, grid.size_px).long()
    right = (torch.floor(torch.maximum(a, b) / grid.resolution_m) + 1).clamp(0, grid.size_px).long().maximum(left)
    return left, right, touches.to(torch.int16)
