"""The paper's encoding, the cumulative dynamic sensor projection."""

from typing import ClassVar

import torch
from pydantic.dataclasses import dataclass
from torch import Tensor

from repro.fields import OLDEST_GRAY, STRICT, Gray
from repro.maps.grid import Grid
from repro.scans import Scans


@dataclass(frozen=True, config=STRICT)
class Projection:
    """The cumulative dynamic sensor projection: one gray-scale image, 0 black to 255 white.

    Every hit is placed in the global frame by pose and beam angle. The newest hit of a pixel
    determines its gray: of T steps, the last is black (0), the first has the gray `oldest_gray`, and the steps between
    are interpolated linearly. The background is white.

    Paper: "Cumulative Dynamic Sensor Projection" and, for `decay=False`, "Ablation Study". The decay law is not
    stated: DEVIATIONS D7.

    Args:
        decay: False draws all hits black.
        oldest_gray: gray of the oldest hit, in [0, 254/255]; 1 is the white background.

    Raises:
        ValueError: a parameter has another type or is out of its range.
    """

    name: ClassVar[str] = "projection"
    channels: ClassVar[int] = 1
    frames: ClassVar[int] = 1
    is_binary: ClassVar[bool] = False
    reach_m: ClassVar[float] = 0.0

    decay: bool = True
    oldest_gray: Gray = OLDEST_GRAY

    def with_range(self, range_max_m: float) -> "Projection":
        return self

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        """Draw the projection of each window.

        Args:
            scans: a batch of windows, as tensors.
            grid: grid of the images.

        Returns:
            gray images, uint8, (B, 1, H, W); darker is more recent.
        """
        newest, steps = newest_hits(scans, grid), scans.ranges.shape[1]
        shades = torch.zeros(steps + 1)
        if self.decay:
            shades[1:] = torch.linspace(0, self.oldest_gray, steps).flip(0)
        shades[0] = 1
        shades = (255 * shades).round().to(newest.device, torch.uint8)
        return shades.index_select(0, newest.flatten()).view_as(newest)[:, None]  # much faster than indexing

    def to_input(self, images: Tensor) -> Tensor:
        return images.to(torch.float32, copy=True).div_(255)


def inverted(images: Tensor) -> Tensor:
    """Convert images, uint8, to the input of a network with inverted intensities: 1 is black, 0 is white.

    Adds in place, because the memory of a temporary is returned to the system and fetched again in every call.
    """
    return images.to(torch.float32, copy=True).div_(-255).add_(1)


def newest_hits(scans: Scans, grid: Grid) -> Tensor:
    """Return the newest step at which each pixel was hit.

    Args:
        scans: a batch of windows, as tensors.
        grid: grid of the images.

    Returns:
        the step, counted from 1, 0 without a hit, int64, (B, H, W).
    """
    pixels, hit = hit_pixels(scans, grid)
    batch, steps, _ = hit.shape
    step = torch.arange(1, steps + 1, device=hit.device)[:, None]
    newest = torch.zeros(batch, grid.size_px**2, dtype=torch.long, device=hit.device)
    newest.scatter_reduce_(1, pixels.flatten(1), torch.where(hit, step, 0).flatten(1), reduce="amax")
    return newest.view(batch, grid.size_px, grid.size_px)


def hit_pixels(scans: Scans, grid: Grid) -> tuple[Tensor, Tensor]:
    """Return the pixel of each hit, from its range, beam angle and pose.

    Args:
        scans: a batch of windows, as tensors.
        grid: grid of the images.

    Returns:
        pixels: flat pixel index, row-major, (B, T, N); 0 where there is no hit.
        hit: whether the beam hits something on the map, (B, T, N).
    """
    points, hit = scans.points()
    pixels, inside = grid.pixels(points)
    return pixels, hit & inside
