"""Pairs for training and evaluation: (encoded scans, true map) as uint8 images in memory."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from repro.maps.encodings import Encoding, create_encoding
from repro.maps.grid import Grid
from repro.maps.statistics import Statistics, summarize
from repro.maps.visibility import shown_pixels
from repro.recordings.reader import Recordings
from repro.recordings.recorded import true_maps
from repro.runs.config import RunConfig
from repro.system.errors import InputError
from repro.system.progress import progress

HIDDEN = 2  # added to the pixels of a map that standing obstacles hide from every lidar
STATISTICS_PAIRS = 4000  # more change the quantiles little


@dataclass(frozen=True)
class Pairs:
    """All pairs of one split.

    Args:
        stored: encoded scans, packed, see `packed`.
        maps: true maps at the last step, uint8, (M, 1, H, W); 1 is free, 0 is an obstacle; if the training asks for
            them, pixels that standing obstacles hide from a lidar of 360 degrees at the last step have 2 more.
        encoding: the encoding that drew the images.
    """

    stored: Tensor
    maps: Tensor
    encoding: Encoding

    def __len__(self) -> int:
        return len(self.maps)

    def image_batches(self, size: int) -> Iterator[np.ndarray]:
        """Yield all encoded scans in batches, uint8, (B, C, H, W), without drawing them at once."""
        return (self._drawn(stored).numpy(force=True) for stored in self.stored.split(size))

    def batch(self, index: Tensor) -> tuple[Tensor, Tensor]:
        """Return the pairs of an index (B,) as float32: inputs in [0, 1], (B, C, H, W), and maps, (B, 1, H, W)."""
        images = self._drawn(self.stored[index]).to(torch.float32, copy=True)  # then as `maps.encodings.to_input`
        images = images.div_(-255).add_(1) if self.encoding.is_inverted else images.div_(255)
        return images, self.maps[index].float()

    def _drawn(self, stored: Tensor) -> Tensor:
        bits, step = self.encoding.bits, _step(self.encoding)
        if bits == 8:
            return stored
        shifts = torch.arange(8 - bits, -1, -bits, dtype=torch.uint8, device=stored.device)
        grays = (stored[..., None] >> shifts).bitwise_and_(2**bits - 1).mul_(step)
        return grays.flatten(-2)[..., : self.maps.shape[-1]]

    def __deepcopy__(self, _: dict) -> "Pairs":
        """Return the pairs themselves: they are immutable, so that a copied training module can share them."""
        return self


def packed(images: np.ndarray, encoding: Encoding) -> Tensor:
    """Pack the pixels of images, uint8, (..., W), in the bits that an encoding needs, (..., W bits / 8), rounded up."""
    bits = encoding.bits
    if bits == 8:
        return torch.from_numpy(images)
    grays = images // np.uint8(_step(encoding))
    lacking = -images.shape[-1] % (8 // bits)
    grays = np.pad(grays, [(0, 0)] * (images.ndim - 1) + [(0, lacking)])
    of_bytes = grays.reshape(*grays.shape[:-1], -1, 8 // bits) << np.arange(8 - bits, -1, -bits, dtype=np.uint8)
    return torch.from_numpy(np.bitwise_or.reduce(of_bytes, axis=-1))


def _step(encoding: Encoding) -> int:
    """Return the difference between two grays of the images of an encoding that follow each other."""
    return 255 // (2**encoding.bits - 1)


class Batches:
    """Batches of one epoch, gathered on the device that holds the pairs.

    Args:
        pairs: the pairs of the split.
        batch_size: pairs per batch, B.
        seed: seed of the shuffling; None keeps the order of the pairs.
        flip_augmentation: flip a random half of the pairs top to bottom. This is an exact symmetry of the paper's
            worlds: obstacles are distributed equally above and below, and the mirrored path is that of the twin.

    Raises:
        InputError: there are fewer training pairs than one batch needs.
    """

    def __init__(
        self, pairs: Pairs, batch_size: int, seed: int | None = None, *, flip_augmentation: bool = False
    ) -> None:
        self.pairs = pairs
        self.batch_size = batch_size
        self.seed = seed
        self.flip_augmentation = flip_augmentation
        if seed is not None and len(pairs) < batch_size:
            raise InputError(f"train.batch_size={batch_size} but there are only {len(pairs)} training pairs")

    def __len__(self) -> int:
        full, rest = divmod(len(self.pairs), self.batch_size)
        return full + (rest > 0 and self.seed is None)  # training drops a last batch that is not full

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        order = torch.arange(len(self.pairs))
        flipped = torch.zeros(len(self.pairs), dtype=torch.bool)
        if self.seed is not None:
            generator = torch.Generator().manual_seed(self.seed)
            order = torch.randperm(len(self.pairs), generator=generator)
            if self.flip_augmentation:
                flipped = torch.rand(len(self.pairs), generator=generator) < 0.5
        device = self.pairs.maps.device
        batches = zip(order.to(device).split(self.batch_size), flipped.to(device).split(self.batch_size), strict=True)
        for index, flip in islice(batches, len(self)):
            image, target = self.pairs.batch(index)
            yield (_flip(image, flip), _flip(target, flip)) if self.flip_augmentation else (image, target)


def load_pairs(
    recordings: Recordings,
    split: str,
    grid: Grid,
    encoding: Encoding,
    *,
    count: int | None = None,
    device: torch.device | str = "cpu",
    marks_hidden: bool = False,
) -> Pairs:
    """Create the pairs of a split from its recordings.

    Args:
        split: train, val or test.
        grid: grid of the images and maps.
        encoding: the encoding that draws the scans.
        count: number of pairs to cover, from the first; None for all, see `Recordings.shards`.
        device: device on which the images are kept.
        marks_hidden: whether the maps mark the pixels that standing obstacles hide at the last step, see `Pairs`.

    Raises:
        InputError: a shard fails verification, see `Recordings.shards`, or the encoding draws other images
            than it should.
    """
    shards = progress(recordings.shards(split, count), f"drawing {split}")
    room = count or recordings.manifest.pairs[split]
    width = math.ceil(grid.size_px * encoding.bits / 8)
    stored, maps = (  # filled shard by shard: joining them at the end would take twice the memory
        torch.empty(room, *shape, dtype=torch.uint8, device=device)
        for shape in ((encoding.channels, grid.size_px, width), (1, grid.size_px, grid.size_px))
    )
    first = 0
    for shard in shards:
        drawn = slice(first, first + len(shard.scans))
        images = encoding.encode(shard.scans.batched(), grid)
        _check_images(images, encoding, (len(shard.scans), *stored.shape[1:3], grid.size_px))
        stored[drawn] = packed(images, encoding).to(device)
        free = true_maps(shard, grid)
        if marks_hidden:
            standing = true_maps(shard, grid, only_standing=True)
            free[~shown_pixels(standing, shard.scans.poses[:, -1], grid)] += HIDDEN
        maps[drawn, 0] = torch.from_numpy(free).to(device)
        first = drawn.stop
    return Pairs(stored, maps, encoding)


def _check_images(images: np.ndarray, encoding: Encoding, shape: tuple[int, ...]) -> None:
    """Check the type, the shape and, if a bit per pixel is stored, the values of the images of an encoding."""
    if (images.dtype, images.shape) != (np.uint8, shape):
        raise InputError(
            f"the encoding {encoding.name} must draw images of uint8, {shape}, got {images.dtype}, {images.shape}"
        )
    step = _step(encoding)
    if (images % np.uint8(step)).any():
        raise InputError(f"the encoding {encoding.name} has {encoding.bits} bits and must draw multiples of {step}")


def load_pairs_of_run(
    recordings: Recordings, split: str, config: RunConfig, device: str, *, marks_hidden: bool = False
) -> Pairs:
    """Create the pairs of a split for the configuration of a run, see `load_pairs`."""
    grid, encoding, count = grid_of(config), encoding_of(config), getattr(config.data.pairs, split)
    return load_pairs(recordings, split, grid, encoding, count=count, device=device, marks_hidden=marks_hidden)


def training_statistics(recordings: Recordings, config: RunConfig) -> Statistics:
    """Compute the statistics of the training scans of a run, of the first `STATISTICS_PAIRS` at most."""
    count = min(config.data.pairs.train, STATISTICS_PAIRS)
    shards = recordings.shards("train", count)
    return summarize((shard.scans.batched() for shard in shards), grid_of(config))


def _flip(images: Tensor, flipped: Tensor) -> Tensor:
    """Flip the images (B, C, H, W) for which `flipped` (B,) is true top to bottom."""
    return torch.where(flipped[:, None, None, None], images.flip(-2), images)


def grid_of(config: RunConfig) -> Grid:
    """Create the grid of a run."""
    return Grid(config.data.size_px, config.data.size_m)


def encoding_of(config: RunConfig) -> Encoding:
    """Create the encoding of a run."""
    assert config.encoding, "a baseline has no encoding"
    return create_encoding(config.encoding.name, config.encoding.parameters)
