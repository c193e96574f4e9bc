"""Recordings on disk: write, resume, verify, read.

One directory an experiment: shards and a manifest with the SHA-256 of each. Nothing is read that is not what was
recorded; recording again mends what is missing, cut or altered, to the same bytes.
"""

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import joblib
from tqdm import tqdm

from repro.files import clear_leftovers, lock, read_typed, sha256, write_json
from repro.scans import Scans
from repro.simulation.shards import (
    FORMAT,
    SPLIT_SEEDS,
    SPLITS,
    BrokenShard,
    Shard,
    ShardContent,
    holds,
    read_shard,
    shards_of,
    spec_fingerprint,
    write_shard,
)


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


def record_experiment(
    directory: Path,
    spec: dict[str, Any],
    pairs: dict[str, int],
    *,
    workers: int = 2,
    verify_every: int = 500,
) -> Manifest:
    """Records what is missing, cut or altered of one experiment and writes its manifest.

    Recordings that hold more training pairs than are asked for serve as they are: the first so many are the same.

    Args:
        directory: where the shards go, made if missing.
        spec: what `worlds.sample_world` takes.
        pairs: recordings per split, each even: a world and its twin are two.
        workers: processes.
        verify_every: every so many worlds, one is replayed by plain IR-SIM and compared.

    Raises:
        ValueError: a count is odd, what is there is of another configuration, or IR-SIM disagrees.
    """
    fingerprint = spec_fingerprint(spec)
    directory.mkdir(parents=True, exist_ok=True)
    with ExitStack() as alone:  # a second process waits here, then finds the work done
        for name in (".lock", *sorted(path.name for path in directory.glob(".lock-*-of-*"))):
            alone.enter_context(lock(directory, name))  # and so do we for those that record a part
        before = read_manifest(directory) if (directory / "manifest.json").is_file() else None
        if before and (before.fingerprint != fingerprint or not holds(before.pairs, pairs)):
            raise ValueError(
                f"{directory} holds {before.pairs} pairs of another configuration than the {dict(pairs)} asked "
                "for: delete it or use another outputs"
            )
        pairs = before.pairs if before else pairs
        shards = list(shards_of(pairs))
        clear_leftovers(directory)
        checksums = {name: entry.sha256 for name, entry in before.shards.items()} if before else {}
        missing = [s for s in shards if not _is_whole(directory / s.name, fingerprint, checksums.get(s.name))]
        if before and not missing:
            return before
        _write_shards(directory, missing, spec, workers, verify_every, sum(shard.worlds for shard in shards))
        manifest = Manifest(
            FORMAT,
            spec,
            fingerprint,
            dict(pairs),
            {name: version(name) for name in ("ir-sim", "numpy", "repro")},
            {shard.name: ShardEntry(**asdict(shard), sha256=sha256(directory / shard.name)) for shard in shards},
        )
        write_json(directory / "manifest.json", dataclasses.asdict(manifest))
    return manifest


def record_part(
    directory: Path,
    spec: dict[str, Any],
    pairs: dict[str, int],
    part: int,
    parts: int,
    *,
    workers: int = 2,
    verify_every: int = 500,
) -> bool:
    """Records every `parts`-th shard from number `part` on, so that several machines share one experiment.

    Returns:
        whether all shards are there now: then `record_experiment` has but to look at them and write the manifest.

    Raises:
        ValueError: see `record_experiment`.
    """
    directory.mkdir(parents=True, exist_ok=True)
    if (directory / "manifest.json").is_file():
        return True
    shards, fingerprint = list(shards_of(pairs)), spec_fingerprint(spec)
    with lock(directory, f".lock-{part}-of-{parts}"):
        missing = [shard for shard in shards[part::parts] if not _is_whole(directory / shard.name, fingerprint, None)]
        worlds = sum(shard.worlds for shard in shards[part::parts])
        _write_shards(directory, missing, spec, workers, verify_every, worlds)
    return all((directory / shard.name).is_file() for shard in shards)


def read_manifest(directory: Path) -> Manifest:
    """Reads the manifest of a recorded experiment.

    Raises:
        ValueError: there is none, it cannot be read, or it names worlds that do not belong to their split.
    """
    path = directory / "manifest.json"
    if not path.is_file():
        raise ValueError(f"no complete recordings in {directory}: give the same command with task=record first")
    cure = f"delete it and give the same command with task=record; the shards in {directory} are kept"
    manifest = read_typed(Manifest, path, cure)
    for split, count in manifest.pairs.items():
        entries = [entry for entry in manifest.shards.values() if entry.split == split]
        first = SPLITS.get(split, -1)
        within = all(first <= e.first_seed <= first + SPLIT_SEEDS - e.worlds for e in entries)
        named = all(manifest.shards.get(entry.name) == entry for entry in entries)
        if not within or not named or 2 * sum(entry.worlds for entry in entries) != count:
            raise ValueError(f"{path} cannot be read (its shards of the split {split} are not {split}'s): {cure}")
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


def _is_whole(path: Path, fingerprint: str, checksum: str | None) -> bool:
    """Says whether a shard is there and what it should be, and tells where it is there and is not."""
    if not path.is_file():
        return False
    try:
        if checksum is None:
            read_shard(path, fingerprint)
        elif sha256(path) != checksum:
            raise BrokenShard(f"shard {path} is not what was recorded")
    except BrokenShard as error:
        print(f"recording again: {error}", flush=True)
        return False
    return True


def _write_shards(directory: Path, shards: list[Shard], spec: dict, workers: int, every: int, worlds: int) -> None:
    jobs = (joblib.delayed(write_shard)(directory, shard, spec, every) for shard in shards)
    # processes, also inside a worker of a launcher: IR-SIM keeps its environment in module variables
    parallel = joblib.Parallel(n_jobs=workers, backend="loky", return_as="generator_unordered")
    done = worlds - sum(shard.worlds for shard in shards)
    with tqdm(
        total=2 * worlds, initial=2 * done, unit="recording", desc=f"exp {spec['experiment']}", disable=None
    ) as bar:
        for count in parallel(jobs):
            bar.update(2 * count)
