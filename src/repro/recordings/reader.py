"""Recordings on disk: write, resume, verify, read.

One directory an experiment: shards and a manifest with the SHA-256 of each. Nothing is read that is not what was
recorded; recording again mends what is missing, cut or altered, to the same bytes.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from repro.recordings.format import (
    SPLIT_SEEDS,
    SPLITS,
    BrokenShard,
    Shard,
    ShardContent,
    holds,
    read_shard,
)
from repro.scans import Scans
from repro.system.files import read_typed, sha256


@dataclass(frozen=True)
class ShardEntry(Shard):
    """A shard and the checksum of its file."""

    sha256: str


@dataclass(frozen=True)
class Manifest:
    """What a recorded experiment is: written last, so that where it stands the recordings are complete."""

    format: int
    spec: dict[str, Any]
    fingerprint: str
    pairs: dict[str, int]
    versions: dict[str, str]
    shards: dict[str, ShardEntry]


def read_manifest(directory: Path) -> Manifest:
    """Reads the manifest of a recorded experiment.

    Raises:
        ValueError: there is none, it cannot be read, or it names worlds that do not belong to their split.
    """
    path = directory / "manifest.json"
    if not path.is_file():
        raise ValueError(f"no complete recordings in {directory}: give the same command with task=record first")
    fix = f"delete it and give the same command with task=record; the shards in {directory} are kept"
    manifest = read_typed(Manifest, path, fix)
    for split, count in manifest.pairs.items():
        entries = [entry for entry in manifest.shards.values() if entry.split == split]
        first = SPLITS.get(split, -1)
        within = all(first <= e.first_seed <= first + SPLIT_SEEDS - e.worlds for e in entries)
        named = all(manifest.shards.get(entry.name) == entry for entry in entries)
        if not within or not named or 2 * sum(entry.worlds for entry in entries) != count:
            raise ValueError(f"{path} cannot be read (its shards of the split {split} are not {split}'s): {fix}")
    return manifest


def read_shards(directory: Path, split: str, count: int | None = None) -> Iterator[ShardContent]:
    """Reads the shards of a split in order, each checked against the manifest.

    Args:
        directory: a recorded experiment.
        split: train, val or test.
        count: the first so many recordings, see `holds`; all without it.

    Raises:
        ValueError: a shard is missing, truncated, altered, or of another configuration, or there are fewer recordings.
    """
    manifest = read_manifest(directory)
    asked = manifest.pairs | ({split: count} if count else {})
    for entry in _used(directory, manifest, asked):
        if entry.split == split:
            path = directory / entry.name
            if not path.is_file() or sha256(path) != entry.sha256:
                state = "is not what was recorded" if path.is_file() else "is missing"
                raise BrokenShard(f"shard {path} {state}: task=record with the same words records it again")
            yield read_shard(path, manifest.fingerprint)


def read_scans(directory: Path, split: str, index: int) -> Scans:
    """Reads the scans of one recording of a split, ranges (T, N).

    Raises:
        ValueError: the split has no such recording, or its shard cannot be trusted.
    """
    first = 0
    for shard in read_shards(directory, split):
        if first <= index < first + len(shard.scans):
            return shard.scans[index - first]
        first += len(shard.scans)
    raise ValueError(f"{directory} has {first} recordings in {split}, none of index {index}")


def recordings_hash(directory: Path, pairs: Mapping[str, int] | None = None) -> str:
    """Hashes the shards that hold some pairs together, all without `pairs`, for the provenance of what they make.

    Raises:
        ValueError: there are no such recordings.
    """
    manifest = read_manifest(directory)
    checksums = [entry.sha256 for entry in _used(directory, manifest, pairs or manifest.pairs)]
    return hashlib.sha256("".join(checksums).encode()).hexdigest()


def _used(directory: Path, manifest: Manifest, asked: Mapping[str, int]) -> Iterator[ShardEntry]:
    """Yields the shards that hold the pairs asked for."""
    if not holds(manifest.pairs, asked):
        raise ValueError(f"{directory} holds {manifest.pairs} pairs, which do not serve for {dict(asked)}")
    left = dict(asked)
    for entry in manifest.shards.values():
        if left[entry.split] > 0:
            left[entry.split] -= 2 * entry.worlds
            yield entry
