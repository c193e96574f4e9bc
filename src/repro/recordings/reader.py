"""Read and verify recordings.

The directory of an experiment holds its shards and a manifest with the SHA-256 checksum of each shard. Every shard is
verified before it is read. `simulation.recorder` writes the shards and restores damaged ones.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from repro.recordings.format import BrokenShard, Shard, ShardContent, has_pairs, read_shard
from repro.system.errors import InputError
from repro.system.files import read_typed, sha256
from repro.worlds.spec import WorldSpec


@dataclass(frozen=True)
class ShardEntry(Shard):
    """A shard with the checksum of its file."""

    sha256: str


@dataclass(frozen=True)
class Manifest:
    """The description of a recorded experiment; it is written last, so its presence means complete recordings."""

    format: int
    spec: dict[str, Any]
    fingerprint: str
    pairs: dict[str, int]
    versions: dict[str, str]
    shards: dict[str, ShardEntry]

    @cached_property
    def world_spec(self) -> WorldSpec:
        """What decides the worlds.

        Raises:
            InputError: it is damaged, or of a version with other keys.
        """
        return WorldSpec.parse(self.spec)


@dataclass(frozen=True)
class Recordings:
    """The complete recordings of an experiment in a directory, see `open_recordings`."""

    directory: Path
    manifest: Manifest

    @property
    def spec(self) -> WorldSpec:
        """What decides the worlds, see `Manifest.world_spec`."""
        return self.manifest.world_spec

    def check_worlds(self, fingerprint: str) -> None:
        """Check that they are of the worlds that a run is configured for, see `format.spec_fingerprint`.

        Raises:
            InputError: they are of other worlds.
        """
        if self.manifest.fingerprint != fingerprint:
            raise InputError(
                f"{self.directory} holds recordings of other worlds than the configuration describes: "
                "use the world and exp they were recorded with, or another recordings= or outputs="
            )

    def shards(self, split: str, count: int | None = None) -> Iterator[ShardContent]:
        """Yield the shards of a split in order, each verified against the manifest.

        Args:
            split: train, val or test.
            count: number of recordings to cover, from the first, see `format.has_pairs`; None for all.

        Raises:
            InputError: a shard is missing, truncated, altered, or of another configuration, or there are too few.
        """
        asked = self.manifest.pairs | ({split: count} if count else {})
        for entry in self._used(asked):
            if entry.split == split:
                path = self.directory / entry.name
                if not path.is_file() or sha256(path) != entry.sha256:
                    state = "is not what was recorded" if path.is_file() else "is missing"
                    raise BrokenShard(f"shard {path} {state}: run the same command with task=record to record it again")
                yield read_shard(path, self.manifest.fingerprint)

    def hash(self, pairs: Mapping[str, int] | None = None) -> str:
        """Hash the checksums of the shards that hold `pairs`, None for all, for provenance: a SHA-256 in hexadecimal.

        Raises:
            InputError: there are no such recordings.
        """
        checksums = [entry.sha256 for entry in self._used(pairs or self.manifest.pairs)]
        return hashlib.sha256("".join(checksums).encode()).hexdigest()

    def _used(self, asked: Mapping[str, int]) -> Iterator[ShardEntry]:
        """Yield the shards that hold the requested pairs."""
        pairs = self.manifest.pairs
        if not has_pairs(pairs, asked):
            raise InputError(f"{self.directory} holds {pairs} pairs, which do not cover the requested {dict(asked)}")
        left = dict(asked)
        for entry in self.manifest.shards.values():
            if left[entry.split] > 0:
                left[entry.split] -= 2 * entry.worlds
                yield entry
        if any(count > 0 for count in left.values()):
            raise BrokenShard(f"the manifest in {self.directory} lacks shards: delete it and record again")


def open_recordings(directory: Path) -> Recordings:
    """Read the manifest of a recorded experiment.

    Raises:
        InputError: the manifest is missing or cannot be read.
    """
    path = directory / "manifest.json"
    if not path.is_file():
        raise InputError(f"no complete recordings in {directory}: run the same command with task=record first")
    fix = f"delete it and run the same command with task=record; the shards in {directory} are kept"
    return Recordings(directory, read_typed(Manifest, path, fix))
