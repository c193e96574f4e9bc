"""Record experiments: sample worlds, simulate both directions, write shards and the manifest.

Recording again repairs what is missing, truncated or altered, to the same bytes.
"""

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from repro.maps.outlines import padded
from repro.recordings.format import (
    FORMAT,
    SHARD_WORLDS,
    BrokenShard,
    Shard,
    has_pairs,
    read_shard,
    shards_of,
    spec_fingerprint,
)
from repro.recordings.reader import Manifest, ShardEntry, open_recordings
from repro.runs.parallel import process_pool
from repro.scans import Scans
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.sensing import sensed
from repro.simulation.simulator import Recording, check_replay, simulate
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, replacing, sha256, write_json
from repro.system.progress import progress, say
from repro.worlds.spec import WorldSpec

VERIFY_EVERY = 500  # worlds, of which one is replayed in plain IR-SIM


def record_experiment(
    directory: Path, spec: WorldSpec, pairs: dict[str, int], *, workers: int = 2, verify_every: int = VERIFY_EVERY
) -> Manifest:
    """Record the missing, truncated or altered shards of one experiment and write its manifest.

    Existing recordings with more training pairs than requested are used unchanged: their first pairs are the same.

    Args:
        directory: directory of the shards, created if missing.
        pairs: recordings per split, each even, since a world and its twin are two recordings.
        verify_every: interval [worlds] at which a world is replayed in plain IR-SIM and compared.

    Raises:
        InputError: a count is odd, existing recordings are of another configuration, or IR-SIM disagrees.
    """
    fingerprint = spec_fingerprint(spec)
    directory.mkdir(parents=True, exist_ok=True)
    with _exclusive(directory):  # a second process waits here and then finds the shards complete
        existing = open_recordings(directory).manifest if (directory / "manifest.json").is_file() else None
        if existing and existing.fingerprint != fingerprint:
            raise InputError(f"{directory} has recordings of other worlds: delete it, or set outputs= or recordings=")
        if existing and not has_pairs(existing.pairs, pairs):
            raise InputError(
                f"{directory} has {existing.pairs} pairs, {dict(pairs)} are requested: expected the same numbers, or "
                f"fewer training pairs that are a multiple of {2 * SHARD_WORLDS}; otherwise set outputs= or recordings="
            )
        pairs = existing.pairs if existing else pairs
        shards = list(shards_of(pairs))
        checksums = {name: entry.sha256 for name, entry in existing.shards.items()} if existing else {}
        missing = [s for s in shards if not _is_whole(directory / s.name, fingerprint, checksums.get(s.name))]
        if existing and not missing:
            return existing
        _write_shards(directory, missing, spec, workers, verify_every, sum(shard.worlds for shard in shards))
        manifest = Manifest(
            FORMAT,
            spec.raw,
            fingerprint,
            dict(pairs),
            {name: version(name) for name in ("ir-sim", "numpy")},
            {shard.name: ShardEntry(**asdict(shard), sha256=sha256(directory / shard.name)) for shard in shards},
        )
        write_json(directory / "manifest.json", dataclasses.asdict(manifest))
    return manifest


@contextmanager
def _exclusive(directory: Path) -> Iterator[None]:
    """Lock the recordings, unless they can only be read, as on a shared disk."""
    if not os.access(directory, os.W_OK):
        yield
        return
    with lock(directory):
        clear_leftovers(directory)
        yield


def write_shard(directory: Path, shard: Shard, spec: WorldSpec, verify_every: int) -> int:
    """Record one shard and return its number of worlds.

    Args:
        verify_every: interval [worlds] at which a world is replayed in plain IR-SIM and compared.

    Raises:
        InputError: IR-SIM disagrees.
    """
    recordings: list[Recording] = []
    for seed in range(shard.first_seed, shard.first_seed + shard.worlds):
        world = sample_world(spec, seed)
        for number, item in enumerate((world, reverse_direction(world))):
            recording = simulate(item)
            if seed % verify_every == 0:
                check_replay(item, recording)
            if spec.sensing:
                rng = np.random.default_rng([seed, number])
                scans = sensed(recording.scans, spec.sensing, spec.lidar.range_max, rng)
                recording = dataclasses.replace(recording, scans=scans)
            recordings.append(recording)
    worlds = recordings[::2]
    scans = Scans.stack([item.scans for item in recordings])
    most, longest = (max(item.outlines.shape[axis] for item in worlds) for axis in (0, 1))
    arrays: dict[str, Any] = {
        "ranges": scans.ranges.astype(np.float32),
        "angles": scans.angles,
        "poses": scans.poses,
        "outlines": np.concatenate([padded(item.outlines, longest) for item in worlds]).astype(np.float32),
        "states": np.concatenate([item.states for item in worlds]).astype(np.float32),
        "world": np.repeat(np.arange(len(worlds)), [len(item.outlines) for item in worlds]),
        "seen": np.stack([np.pad(item.seen, (0, most - len(item.seen))) for item in recordings]),
        "fingerprint": np.array(spec_fingerprint(spec)),
    }
    with replacing(directory / shard.name) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)
    return shard.worlds


def _is_whole(path: Path, fingerprint: str, checksum: str | None) -> bool:
    """Check whether a shard exists and is intact; print a message if it exists but is damaged."""
    if not path.is_file():
        return False
    try:
        if checksum is None:
            read_shard(path, fingerprint)
        elif sha256(path) != checksum:
            raise BrokenShard(f"shard {path} is not what was recorded")
    except BrokenShard as error:
        say(f"recording again: {error}")
        return False
    return True


def _write_shards(directory: Path, shards: list[Shard], spec: WorldSpec, workers: int, every: int, worlds: int) -> None:
    jobs = (joblib.delayed(write_shard)(directory, shard, spec, every) for shard in shards)
    # processes even inside a worker of a launcher, because IR-SIM keeps its environment in module variables
    done = worlds - sum(shard.worlds for shard in shards)
    with (
        process_pool(workers, return_as="generator_unordered") as parallel,
        progress(description=f"recording exp {spec.experiment}", total=2 * worlds, done=2 * done) as bar,
    ):
        for written in parallel(jobs):
            bar.update(2 * written)
