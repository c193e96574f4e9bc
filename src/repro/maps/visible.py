"""What a lidar has seen: the newest step at which each pixel lay in its field of view, and was not hidden there."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor
from torch.nn import functional

from repro.maps.grid import Grid
from repro.scans import Scans

IN_CACHE = 2**16  # pixels that are worked on together on a CPU


def newest_visible(scans: Scans, grid: Grid, range_max_m: float, *, margin_m: float = 0.0) -> tuple[Tensor, Tensor]:
    """Finds the newest step at which each pixel was visible, and at which it lay in the field of view at all.

    A pixel lies in the field of view of a step where its centre is within the lidar's range and nearer to one of
    its beams than half the angle between two. It is visible there where it is no farther than that beam reached. All
    of it follows from the scans alone, no map is asked.

    Args:
        scans: a batch of windows, as tensors; the beam angles are evenly spaced and rise.
        grid: where the pixels are.
        range_max_m: how far a beam reaches that hits nothing [m].
        margin_m: by how much farther than the beam reached a pixel still counts as visible [m]: half a pixel
            takes in the surface that was hit, minus half a pixel leaves it out.

    Returns:
        the newest step at which the pixel was visible, and at which it lay in the field of view, each counted from 1,
        0 for never, int16, (B, H, W).

    Raises:
        ValueError: the beam angles are not evenly spaced and rising.
    """
    shape = (len(scans), grid.size_px, grid.size_px)
    visible, in_view = (torch.zeros(shape, dtype=torch.int16, device=scans.ranges.device) for _ in range(2))
    few = max(1, IN_CACHE // grid.size_px**2) if scans.ranges.device.type == "cpu" else len(scans)
    for first in range(0, len(scans), few):
        here = slice(first, first + few)
        for step, (clear, within) in enumerate(step_by_step(scans[here], grid, range_max_m, margin_m=margin_m)):
            for newest, seen in ((visible[here], clear), (in_view[here], within)):
                torch.maximum(newest, seen.short() * (step + 1), out=newest)
    return visible, in_view


def step_by_step(
    scans: Scans, grid: Grid, range_max_m: float, *, margin_m: float = 0.0
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yields for every step which pixels were visible and which lay in the field of view, see `newest_visible`.

    Yields:
        visible, in the field of view, bool, (B, H, W).

    Raises:
        ValueError: the beam angles are not evenly spaced and rising.
    """
    spacing, beams = beam_spacing(scans.angles), len(scans.angles)
    xs, ys = grid.row_centers(scans.ranges.device).flip(0), grid.row_centers(scans.ranges.device)[:, None]
    # of every beam how far it sees, squared, and then of all directions in which there is none
    blind = math.ceil(2 * math.pi / spacing) + 1 - beams
    reach = scans.ranges.clamp(max=range_max_m) + margin_m  # a miss, inf, reaches range_max_m
    reach = functional.pad(torch.where(reach < 0, -1, reach.square()), (0, max(blind, 0)), value=-1)
    first = torch.arange(len(scans), dtype=torch.int32, device=reach.device)[:, None, None] * reach.shape[-1]
    for step in range(reach.shape[1]):
        x, y, heading = (scans.poses[:, step, k, None, None] for k in range(3))
        distance = (xs - x).square() + (ys - y).square()  # squared, (B, H, W)
        bearing = torch.atan2(ys - y, xs - x).sub_(heading + scans.angles[0] - spacing / 2)
        beam = bearing.remainder_(2 * math.pi).div_(spacing).int()  # int64 is ten times slower
        within = (beam < beams) & (distance <= range_max_m**2)
        seen = distance <= reach[:, step].flatten().index_select(0, (beam + first).flatten()).view_as(distance)
        yield within & seen, within


def beam_spacing(angles: Tensor) -> float:
    """Gives the angle between two beams [rad].

    Raises:
        ValueError: they are not evenly spaced and rising.
    """
    gaps = angles.double().diff()
    spacing = float(gaps.mean()) if len(gaps) else 0.0
    if spacing <= 0 or (gaps - spacing).abs().max() > 0.01 * spacing:
        raise ValueError("the beam angles must rise evenly, so that the beam over a pixel is known")
    return spacing
