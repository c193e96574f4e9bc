"""True maps: rasterization of obstacle outlines and states, many maps at once, on the CPU or a GPU."""

import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.outlines import placed

AT_ONCE = 100  # outlines, whose crossings with every row are in memory
_SMALL = 1e-9  # of the squared size of an outline: an area below is rounding


def rasterize(outlines: Tensor, states: Tensor, owner: Tensor, count: int, grid: Grid) -> Tensor:
    """Draw the true maps: a pixel is an obstacle if its center lies in one, or if a line passes through it.

    In every row of pixels, the inside of an outline begins and ends at each crossing of its edges with the center line
    of the row, where the winding number changes. An outline without area is a line string.

    Args:
        outlines: outlines of the obstacles of all maps in their own frame [m], (K, V, 2).
        states: obstacle poses x, y [m], heading [rad], (K, 3).
        owner: index of the map of each obstacle, (K,).
        count: number of maps, B.
        grid: grid of the maps.

    Returns:
        maps, uint8, (B, H, W); 1 is free, 0 is an obstacle.
    """
    placed_outlines, areas = placed(outlines, states), areas_of(outlines)

    # +1 where an interval begins, -1 where it ends; the cumulative sum counts the obstacles over a pixel
    stride = grid.size_px + 1
    edges = torch.zeros(count * grid.size_px * stride, dtype=torch.int16, device=outlines.device)
    for kind, borders in ((areas != 0, _of_areas), (areas == 0, _of_lines)):
        for chosen in kind.nonzero()[:, 0].split(AT_ONCE):
            which, row, column, sign = borders(placed_outlines[chosen], areas[chosen], grid)
            place = (owner[chosen][which] * grid.size_px + row) * stride + column
            edges.scatter_add_(0, place, sign.to(torch.int16))
    cover = edges.view(count, grid.size_px, stride).cumsum(2, dtype=torch.int16)[..., :-1]
    return (cover == 0).to(torch.uint8)


def areas_of(outlines: Tensor) -> Tensor:
    """Return the area in each outline (K, V, 2), positive if counter-clockwise, 0 for a line there and back, (K,)."""
    own = outlines.double()
    own = own - own[:, :1]
    x, y = own.unbind(-1)
    areas = (x * y.roll(-1, 1) - y * x.roll(-1, 1)).sum(1) / 2
    return torch.where(2 * areas.abs() <= _SMALL * own.square().sum(-1).amax(1), 0, areas)


Borders = tuple[Tensor, Tensor, Tensor, Tensor]  # of N intervals: outline, row, column, and the change of their number


def _of_areas(outlines: Tensor, areas: Tensor, grid: Grid) -> Borders:
    """Return where the insides of outlines (K, V, 2) begin and end; the changes add up to 1 inside and 0 outside."""
    rows = grid.row_centers(outlines.device)
    start, end = outlines, outlines.roll(-1, 1)
    which, edge, row = ((start[..., 1:] <= rows) != (end[..., 1:] <= rows)).nonzero().unbind(1)
    (x0, y0), (x1, y1) = (points[which, edge].unbind(-1) for points in (start, end))
    crossing = x0 + (rows[row] - y0) * ((x1 - x0) / (y1 - y0))
    sign = torch.where(y1 > y0, -1, 1) * torch.sign(areas[which]).int()  # left edges of counter-clockwise ones go down
    return which, row, grid.first_column(crossing), sign


def _of_lines(outlines: Tensor, areas: Tensor, grid: Grid) -> Borders:
    """Return where the pixels begin and end through which the segments of lines (K, V, 2) pass."""
    half = grid.resolution_m / 2
    rows = grid.row_centers(outlines.device)
    x0, y0 = (values[..., None] for values in outlines.unbind(-1))
    x1, y1 = x0.roll(-1, 1), y0.roll(-1, 1)
    touches = (torch.maximum(y0, y1) >= rows - half) & (torch.minimum(y0, y1) < rows + half)
    slope = (x1 - x0) / torch.where(y1 == y0, 1, y1 - y0)
    low, high = torch.minimum(y0, y1).maximum(rows - half), torch.maximum(y0, y1).minimum(rows + half)
    is_level = y1 == y0
    a = torch.where(is_level, x0, x0 + (low - y0) * slope)[touches]
    b = torch.where(is_level, x1, x0 + (high - y0) * slope)[touches]
    left = torch.floor(torch.minimum(a, b) / grid.resolution_m).clamp(0, grid.size_px).long()
    right = (torch.floor(torch.maximum(a, b) / grid.resolution_m) + 1).clamp(0, grid.size_px).long().maximum(left)
    which, _, row = touches.nonzero().unbind(1)
    change = torch.tensor([1, -1], device=which.device).repeat_interleave(len(which))
    return which.repeat(2), row.repeat(2), torch.cat([left, right]), change
