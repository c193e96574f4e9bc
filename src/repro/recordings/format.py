"""Format of the recordings on disk: shards of up to 50 worlds, each with its two recordings.

A shard is written atomically and holds the fingerprint of its configuration. Each world has its own seed, so the
content of a shard depends only on that configuration.
"""

import hashlib
import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from repro.scans import Scans
from repro.system.arrays import open_arrays
from repro.system.errors import InputError
from repro.worlds.spec import WorldSpec

FORMAT = 1
SPLITS = {"train": 0, "val": 1_000_000, "test": 2_000_000}  # first world seed of each split
SPLIT_SEEDS = 1_000_000
SHOWN_SEED = 10_000_000  # seed 0 of task=world: these worlds are in no split
SHARD_WORLDS = 50  # worlds per shard, each with two recordings


class BrokenShard(InputError):
    """A shard that cannot be read or was altered after recording."""


@dataclass(frozen=True)
class Shard:
    """The split, number and worlds of one shard."""

    split: str
    number: int
    first_seed: int
    worlds: int

    @property
    def name(self) -> str:
        return f"{self.split}-{self.number:04d}.npz"


@dataclass(frozen=True)
class ShardContent:
    """The content of a shard: R recordings of R / 2 worlds with K obstacles in total, at most O per world.

    Args:
        scans: ranges (R, T, N), angles (N,), poses (R, T, 3); recordings 2 w and 2 w + 1 are world w in
            direction 1 and -1, see `simulation.sampling`.
        outlines: outlines in their own frame [m], (K, V, 2).
        states: obstacle poses x, y [m], heading [rad], (K, T, 3).
        world: index in the shard of the world that each obstacle belongs to, (K,).
        seen: whether any beam of a recording hit each obstacle of its world, (R, O), without the noise of the lidar.
            With noise, this includes the scan before the first step, which is not in `scans`, and hits that noise
            carried out of range: visibility is then an upper bound. Published recordings contain these values.
    """

    scans: Scans
    outlines: np.ndarray
    states: np.ndarray
    world: np.ndarray
    seen: np.ndarray


def shards_of(pairs: Mapping[str, int]) -> Iterator[Shard]:
    """Yield the shards of all splits.

    Raises:
        InputError: a count is odd or below 2.
    """
    for split, count in pairs.items():
        if count % 2 or count < 2:
            raise InputError(f"pairs must be even and at least 2 (a world and its twin), got {split}={count}")
        for number, first in enumerate(range(0, count // 2, SHARD_WORLDS)):
            yield Shard(split, number, SPLITS[split] + first, min(SHARD_WORLDS, count // 2 - first))


def has_pairs(recorded: Mapping[str, int], asked: Mapping[str, int]) -> bool:
    """Check whether recorded pairs cover the requested pairs: the counts agree, or there are more training pairs.

    In the second case the requested training pairs must fill whole shards, so that these shards are identical to
    those of a smaller recording.

    Args:
        recorded: pairs that are there, per split.
        asked: requested pairs per split.
    """
    rest = {split: count for split, count in asked.items() if recorded.get(split) != count}
    spare = "train" in rest and recorded.get("train", 0) > rest["train"] and rest["train"] % (2 * SHARD_WORLDS) == 0
    return set(recorded) == set(asked) and (not rest or (len(rest) == 1 and spare))


def spec_fingerprint(spec: WorldSpec) -> str:
    """Hash everything that determines the content of the recordings, in hexadecimal."""
    content = {"format": FORMAT, "ir-sim": version("ir-sim"), "spec": spec.raw}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def read_shard(path: Path, fingerprint: str) -> ShardContent:
    """Read one shard.

    Raises:
        BrokenShard: the shard cannot be read.
        InputError: the shard was recorded with another configuration.
    """
    try:
        with open_arrays(path) as file:
            arrays = dict(file)
        recorded = str(arrays.pop("fingerprint"))
        scans = Scans(*(arrays.pop(name) for name in ("ranges", "angles", "poses")))
        content = ShardContent(scans, **arrays)
    except (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise BrokenShard(f"shard {path} cannot be read ({error}): record again with task=record") from error
    if recorded != fingerprint:
        raise InputError(f"shard {path} was recorded with another configuration: delete {path.parent} or set outputs=")
    return content
