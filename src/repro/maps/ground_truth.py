"""True maps: rasterization of obstacle outlines and states, many maps at once."""

import numpy as np

from repro.maps.grid import Grid
from repro.maps.outlines import placed

AT_ONCE = 100  # outlines, whose crossings with every row are in memory
_SMALL = 1e-9  # of the squared size of an outline: an area below is rounding


def rasterize(outlines: np.ndarray, states: np.ndarray, owner: np.ndarray, count: int, grid: Grid) -> np.ndarray:
    """Draw the true maps: a pixel is an obstacle if its center lies in one, or if a line passes through it.

    In every row of pixels, the inside of an outline begins and ends at each crossing of its edges with the center line
    of the row, where the winding number changes. An outline without area is a line string.

    Args:
        outlines: outlines of the obstacles of all maps in their own frame [m], (K, V, 2).
        states: obstacle poses x, y [m], heading [rad], (K, 3).
        owner: index of the map of each obstacle, (K,).
        count: number of maps, B.

    Returns:
        maps, uint8, (B, H, W); 1 is free, 0 is an obstacle.
    """
    placed_outlines, areas = placed(outlines, states), areas_of(outlines)

    # +1 where an interval begins, -1 where it ends; the cumulative sum counts the obstacles over a pixel
    stride = grid.size_px + 1
    edges = np.zeros(count * grid.size_px * stride, dtype=np.int16)
    for kind, borders in ((areas != 0, _of_areas), (areas == 0, _of_lines)):
        every = np.flatnonzero(kind)
        for chosen in (every[first : first + AT_ONCE] for first in range(0, len(every), AT_ONCE)):
            which, row, column, sign = borders(placed_outlines[chosen], areas[chosen], grid)
            np.add.at(edges, (owner[chosen][which] * grid.size_px + row) * stride + column, sign.astype(np.int16))
    cover = edges.reshape(count, grid.size_px, stride).cumsum(2, dtype=np.int16)[..., :-1]
    return (cover == 0).astype(np.uint8)


def areas_of(outlines: np.ndarray) -> np.ndarray:
    """Return the area in each outline (K, V, 2), positive if counter-clockwise, 0 for a line there and back, (K,)."""
    own = outlines.astype(float)
    own = own - own[:, :1]
    x, y = own[..., 0], own[..., 1]
    areas = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(1) / 2
    return np.where(2 * np.abs(areas) <= _SMALL * np.square(own).sum(-1).max(1), 0, areas)


Borders = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # of N intervals: outline, row, column, change of count


def _of_areas(outlines: np.ndarray, areas: np.ndarray, grid: Grid) -> Borders:
    """Return where the insides of outlines (K, V, 2) begin and end; the changes add up to 1 inside and 0 outside."""
    rows = grid.row_centers()
    start, end = outlines, np.roll(outlines, -1, 1)
    which, edge, row = ((start[..., 1:] <= rows) != (end[..., 1:] <= rows)).nonzero()
    (x0, y0), (x1, y1) = (points[which, edge].T for points in (start, end))
    crossing = x0 + (rows[row] - y0) * ((x1 - x0) / (y1 - y0))
    sign = np.where(y1 > y0, -1, 1) * np.sign(areas[which])  # left edges of counter-clockwise ones go down
    return which, row, grid.first_column(crossing), sign


def _of_lines(outlines: np.ndarray, areas: np.ndarray, grid: Grid) -> Borders:
    """Return where the pixels begin and end through which the segments of lines (K, V, 2) pass."""
    half = grid.resolution_m / 2
    rows = grid.row_centers()
    x0, y0 = outlines[..., :1], outlines[..., 1:]
    x1, y1 = np.roll(x0, -1, 1), np.roll(y0, -1, 1)
    touches = (np.maximum(y0, y1) >= rows - half) & (np.minimum(y0, y1) < rows + half)
    slope = (x1 - x0) / np.where(y1 == y0, 1, y1 - y0)
    low, high = np.maximum(np.minimum(y0, y1), rows - half), np.minimum(np.maximum(y0, y1), rows + half)
    is_level = y1 == y0
    a = np.where(is_level, x0, x0 + (low - y0) * slope)[touches]
    b = np.where(is_level, x1, x0 + (high - y0) * slope)[touches]
    first = np.floor(np.minimum(a, b) / grid.resolution_m).clip(0, grid.size_px).astype(np.int64)
    end = (np.floor(np.maximum(a, b) / grid.resolution_m) + 1).clip(0, grid.size_px).astype(np.int64)
    which, _, row = touches.nonzero()
    change = np.repeat([1, -1], len(which))
    return np.tile(which, 2), np.tile(row, 2), np.concatenate([first, np.maximum(end, first)]), change
