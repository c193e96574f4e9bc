"""What a lidar has seen: the newest step at which each pixel lay in its field of view, and was not hidden there."""

from collections.abc import Iterator

import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.scans import Scans


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
    for step, (clear, within) in enumerate(step_by_step(scans, grid, range_max_m, margin_m=margin_m)):
        visible.masked_fill_(clear, step + 1)
        in_view.masked_fill_(within, step + 1)
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
    centers = grid.centers(scans.ranges.device)
    reach = scans.ranges.clamp(max=range_max_m) + margin_m  # a miss, inf, reaches range_max_m
    for step in range(scans.ranges.shape[1]):
        offset = centers - scans.poses[:, step, None, :2]  # (B, H W, 2)
        distance = offset.square().sum(-1).sqrt()
        bearing = torch.atan2(offset[..., 1], offset[..., 0]) - scans.poses[:, step, 2:]
        beam = ((bearing - scans.angles[0] + spacing / 2).remainder(2 * torch.pi) / spacing).long()
        within = (beam < beams) & (distance <= range_max_m)
        clear = within & (distance <= reach[:, step].gather(1, beam.clamp(max=beams - 1)))
        shape = (len(scans), grid.size_px, grid.size_px)
        yield clear.view(shape), within.view(shape)


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
