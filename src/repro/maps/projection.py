"""The paper's encoding, the cumulative dynamic sensor projection, and its variants with one or two inverted images."""

import dataclasses
from typing import Any, ClassVar, Literal

import torch
from pydantic.dataclasses import dataclass
from torch import Tensor

from repro.fields import OLDEST_GRAY, STRICT, Gray, Positive
from repro.maps.grid import Grid
from repro.maps.visibility import newest_passed
from repro.scans import Scans


@dataclass(frozen=True, config=STRICT)
class Projection:
    """The cumulative dynamic sensor projection: one gray-scale image, 0 black to 255 white.

    Every hit is placed in the global frame by pose and beam angle. The newest hit of a pixel
    determines its gray: of T steps, the last is black (0), the first has the gray `oldest_gray`, and the steps between
    are interpolated linearly, or approach `oldest_gray` exponentially. The background is white.

    Paper: "Cumulative Dynamic Sensor Projection" and, for `decay=False`, "Ablation Study". The decay law is not
    stated: DEVIATIONS D7.

    Args:
        decay: False draws all hits black.
        oldest_gray: gray of the oldest hit, in [0, 254/255]; 1 is the white background.
        half_life: age at which a hit is halfway from black to `oldest_gray` [steps]; None for the linear law.

    Raises:
        ValueError: a parameter has another type or is out of its range.
    """

    frames: ClassVar[int] = 1
    is_binary: ClassVar[bool] = False

    decay: bool = True
    oldest_gray: Gray = OLDEST_GRAY
    half_life: Positive | None = None

    @property
    def name(self) -> str:
        return "projection" if self.half_life is None else "exponential"

    @property
    def channels(self) -> int:
        return 1

    @property
    def reach_m(self) -> float:
        return 0.0

    @property
    def parameters(self) -> dict[str, Any]:
        return dataclasses.asdict(self)

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
        return self._shade(newest_hits(scans, grid), scans.ranges.shape[1])

    def to_input(self, images: Tensor) -> Tensor:
        return images.to(torch.float32, copy=True).div_(255)

    def _shade(self, newest: Tensor, steps: int) -> Tensor:
        """Map the newest step of each pixel to its gray, 0 to white, (B, H, W) to (B, 1, H, W)."""
        shades = torch.zeros(steps + 1)
        if self.decay:
            shades[1:] = self._law(steps)
        shades[0] = 1
        shades = (255 * shades).round().to(newest.device, torch.uint8)
        return shades.index_select(0, newest.flatten()).view_as(newest)[:, None]  # much faster than indexing

    def _law(self, steps: int) -> Tensor:
        """Return the gray of each step in [0, 1], from the oldest to the newest, (T,)."""
        if self.half_life is None:
            return torch.linspace(0, self.oldest_gray, steps).flip(0)
        return self.oldest_gray * (1 - 0.5 ** (torch.arange(steps - 1, -1, -1) / self.half_life))


@dataclass(frozen=True, config=STRICT)
class Inverted(Projection):
    """The projection with inverted intensities as the input, alone or with a second image; ours, not the paper's.

    The projection encodes position and age of a hit in one gray value, so that an old hit is almost as white as the
    background, and it discards that a beam passed over a pixel. A second image holds one of the two separately. Hits
    are bright in the input, and the background is zero.

    Args:
        second: `hits` adds the projection without decay before the other image, `free` adds an image of when each
            pixel was last observed to be free after it, with the decay of the projection; None adds none.
        range_max_m: maximum range of the lidar [m], up to which a miss shows free pixels.
    """

    second: Literal["hits", "free"] | None = None
    range_max_m: Positive = 30.0

    @property
    def name(self) -> str:
        return {None: "negative", "hits": "ages", "free": "observed_free"}[self.second]

    @property
    def channels(self) -> int:
        return 2 if self.second else 1

    @property
    def reach_m(self) -> float:
        return self.range_max_m if self.second == "free" else 0.0

    def with_range(self, range_max_m: float) -> "Inverted":
        return dataclasses.replace(self, range_max_m=range_max_m)

    def encode(self, scans: Scans, grid: Grid) -> Tensor:
        faded = super().encode(scans, grid)
        if self.second == "hits":
            return torch.cat([torch.where(faded < 255, 0, 255).to(torch.uint8), faded], dim=1)
        if self.second == "free":
            passed = newest_passed(scans, grid, self.range_max_m)
            return torch.cat([faded, self._shade(passed.int(), scans.ranges.shape[1])], dim=1)
        return faded

    def to_input(self, images: Tensor) -> Tensor:
        return inverted(images)


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
