"""Pairs for training and evaluation: (projection, true map) as uint8 images in memory."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from repro.maps.grid import Grid
from repro.maps.projection import project, rasterize
from repro.simulation.store import read_shards


@dataclass(frozen=True)
class Pairs:
    """All pairs of one split.

    Args:
        images: projections, uint8, (M, 1, H, W); 0 is black, 255 the white background.
        maps: true maps at the last step, uint8, (M, 1, H, W); 1 is free, 0 is an obstacle.
    """

    images: Tensor
    maps: Tensor

    def __len__(self) -> int:
        return len(self.images)

    def batch(self, index: Tensor) -> tuple[Tensor, Tensor]:
        """Gathers and casts some pairs: images in [0, 1] and maps, float32, (B, 1, H, W)."""
        return self.images[index].float() / 255, self.maps[index].float()


class Batches:
    """Batches of one epoch, gathered on the device that holds the pairs; shuffled by `seed` when it is given."""

    def __init__(self, pairs: Pairs, batch_size: int, seed: int | None = None) -> None:
        self.pairs, self.batch_size, self.seed = pairs, batch_size, seed
        if seed is not None and len(pairs) < batch_size:
            raise ValueError(f"train.batch_size={batch_size} but there are only {len(pairs)} training pairs")

    def __len__(self) -> int:
        full, rest = divmod(len(self.pairs), self.batch_size)
        return full + (rest > 0 and self.seed is None)  # in training the last, smaller batch is left out

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        order = torch.arange(len(self.pairs))
        if self.seed is not None:
            order = torch.randperm(len(self.pairs), generator=torch.Generator().manual_seed(self.seed))
        order = order.to(self.pairs.images.device)
        for index in order.split(self.batch_size)[: len(self)]:
            yield self.pairs.batch(index)


def load_pairs(
    directory: Path,
    split: str,
    grid: Grid,
    *,
    decay: bool,
    lightest: float,
    device: torch.device | str = "cpu",
) -> Pairs:
    """Makes the pairs of a split from its recordings.

    Args:
        directory: a recorded experiment.
        split: train, val or test.
        grid: the resolution of both images.
        decay: see `projection.project`.
        lightest: see `projection.project`.
        device: where the images are made and stay.

    Raises:
        ValueError: a shard cannot be trusted, see `store.read_shards`.
    """
    images, maps = [], []
    for shard in read_shards(directory, split):
        runs = torch.arange(len(shard["ranges"]), device=device)
        ranges, angles, poses, outlines, states, world = (
            torch.as_tensor(shard[name], device=device).to(dtype)
            for name, dtype in (
                ("ranges", torch.float32),
                ("angles", torch.float32),
                ("poses", torch.float32),
                ("outlines", torch.float32),
                ("states", torch.float32),
                ("world", torch.long),
            )
        )
        images.append(project(ranges, angles, poses, grid, decay=decay, lightest=lightest))
        true = rasterize(outlines, states[:, -1], world, len(runs) // 2, grid)
        maps.append(true[runs // 2])  # twins share the map
    return Pairs(torch.cat(images)[:, None], torch.cat(maps)[:, None])


def load_pairs_of_run(directory: Path, split: str, config: dict[str, Any], device: str) -> Pairs:
    """Makes the pairs of a split as the config.yaml of a run asks for them, see `load_pairs`."""
    data = config["data"]
    grid = Grid(data["size_px"])
    return load_pairs(directory, split, grid, decay=config["decay"], lightest=data["lightest"], device=device)


def coverage(directory: Path, split: str, grid: Grid) -> float:
    """Mean share of the map that obstacles cover at the last step."""
    free = load_pairs(directory, split, grid, decay=False, lightest=0).maps
    return 1 - free.float().mean().item()


def visibility(directory: Path, split: str, grid: Grid) -> float:
    """Share of the obstacle area that belongs to obstacles hit at least once: the ceiling of specificity."""
    seen_px, all_px = 0, 0
    for shard in read_shards(directory, split):
        world, seen = shard["world"], shard["seen"]
        rank = np.arange(len(world)) - np.searchsorted(world, world)  # number of an obstacle in its world
        outlines, states = torch.as_tensor(shard["outlines"]), torch.as_tensor(shard["states"][:, -1])
        owner = torch.arange(len(world))
        area = (1 - rasterize(outlines, states, owner, len(world), grid)).sum((1, 2)).numpy()
        for twin in (0, 1):
            seen_px += area[seen[2 * world + twin, rank]].sum()
            all_px += area.sum()
    return float(seen_px / all_px)


def describe(directory: Path, grid: Grid) -> dict[str, float]:
    """Coverage and visibility of the test split, to be read beside what the paper's tables imply."""
    return {"coverage": coverage(directory, "test", grid), "visibility": visibility(directory, "test", grid)}
