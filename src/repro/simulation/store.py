"""Recordings on disk: write, resume, verify, read.

One directory an experiment: numbered shards of compressed arrays and a manifest. A shard is written to a
temporary name and moved into place, so what carries its final name is whole. It holds the fingerprint of the
configuration that made it, and the manifest its SHA-256. Worlds are seeded one by one, so the content does
not depend on the number of workers.
"""

import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from tqdm import tqdm

from repro.runs import lock, read_provenance, read_status, replace_file, write_provenance
from repro.simulation.recording import Recording, check_replay, record
from repro.simulation.worlds import sample_world, turn_around

FORMAT = 1
SPLITS = {"train": 0, "val": 1_000_000, "test": 2_000_000}  # first world seed of each split
SHARD_WORLDS = 50  # worlds in a shard, each with its two runs


@dataclass(frozen=True)
class Shard:
    """Where one shard lies and which worlds it holds."""

    split: str
    number: int
    first_seed: int
    worlds: int

    @property
    def name(self) -> str:
        return f"{self.split}-{self.number:04d}.npz"


def record_experiment(
    directory: Path,
    spec: dict[str, Any],
    pairs: dict[str, int],
    *,
    workers: int = 2,
    verify_every: int = 500,
) -> dict[str, Any]:
    """Records what is missing of one experiment and writes its manifest.

    Args:
        directory: where the shards go, made if missing.
        spec: what `worlds.sample_world` takes.
        pairs: runs per split, each even: a world and its twin are two.
        workers: processes.
        verify_every: every so many worlds, one is replayed by plain IR-SIM and compared.

    Returns:
        the manifest.

    Raises:
        ValueError: a count is odd, a shard there is of another configuration, or IR-SIM disagrees.
    """
    fingerprint, shards = spec_fingerprint(spec), list(_shards(pairs))
    directory.mkdir(parents=True, exist_ok=True)
    with lock(directory):  # a second process waits here, then finds the work done
        if (directory / "manifest.json").is_file():
            manifest = read_manifest(directory)
            _check_same(directory, manifest, fingerprint, pairs)
            return manifest
        for leftover in directory.glob("*.tmp"):
            leftover.unlink()  # of a process that was killed
        missing = [shard for shard in shards if not (directory / shard.name).is_file()]
        for shard in shards:
            if shard not in missing:
                _read(directory / shard.name, fingerprint)
        jobs = (joblib.delayed(_write_shard)(directory, shard, spec, verify_every) for shard in missing)
        # processes, also inside a worker of a launcher: IR-SIM keeps its environment in module variables
        parallel = joblib.Parallel(n_jobs=workers, backend="loky", return_as="generator_unordered")
        total, done = 2 * sum(s.worlds for s in shards), 2 * sum(s.worlds for s in missing)
        with tqdm(total=total, initial=total - done, unit="run", desc=f"exp {spec['experiment']}") as bar:
            for worlds in parallel(jobs):
                bar.update(2 * worlds)
        manifest = {
            "format": FORMAT,
            "spec": spec,
            "fingerprint": fingerprint,
            "pairs": dict(pairs),
            "versions": {name: version(name) for name in ("ir-sim", "numpy", "repro")},
            "shards": {s.name: {**asdict(s), "sha256": _sha256(directory / s.name)} for s in shards},
        }
        replace_file(directory / "manifest.json", json.dumps(manifest, indent=1))
    return manifest


def read_manifest(directory: Path) -> dict[str, Any]:
    """Reads the manifest of a recorded experiment.

    Raises:
        ValueError: there is none; the message names the command that records it.
    """
    path = directory / "manifest.json"
    if not path.is_file():
        scale, experiment = directory.parent.parent.name, directory.name.removeprefix("exp")
        raise ValueError(
            f"no complete recordings in {directory}; "
            f"record them with: python run.py task=record scale={scale} exp={experiment}"
        )
    return json.loads(path.read_text())


def read_shards(directory: Path, split: str) -> Iterator[dict[str, np.ndarray]]:
    """Reads the shards of a split in order, each checked against the manifest.

    Yields:
        ranges (R, T, N), angles (N,), poses (R, T, 3), outlines (K, V, 2), states (K, T, 3), `world` (K,),
        the world in the shard that each obstacle belongs to, and `seen` (R, O) where O is the most obstacles
        of a world. Runs 2 w and 2 w + 1 are world w counter-clockwise and clockwise.

    Raises:
        ValueError: a shard is missing, truncated, altered, or of another configuration.
    """
    manifest = read_manifest(directory)
    for name, entry in manifest["shards"].items():
        if entry["split"] != split:
            continue
        path = directory / name
        if not path.is_file() or _sha256(path) != entry["sha256"]:
            state = "is not what was recorded" if path.is_file() else "is missing"
            raise ValueError(f"shard {path} {state}: delete {directory} and record it again")
        yield _read(path, manifest["fingerprint"])


def recordings_hash(directory: Path) -> str:
    """One hash over all shards, for the provenance of what is made from them."""
    shards = read_manifest(directory)["shards"]
    return hashlib.sha256("".join(entry["sha256"] for entry in shards.values()).encode()).hexdigest()


def check_recordings(run: Path, recordings: Path) -> None:
    """Notes in a run's provenance which recordings it is made from, or checks that they still are.

    Raises:
        ValueError: the recordings are missing, or others than the run began with.
    """
    used, found = read_provenance(run).get("recordings"), recordings_hash(recordings)
    if used not in (None, found):
        raise ValueError(f"{run} began with other recordings than {recordings} holds now: delete it and train again")
    write_provenance(run, status=read_status(run) or "begun", recordings=found)


def spec_fingerprint(spec: dict[str, Any]) -> str:
    """Hash of everything that decides the content of the recordings."""
    content = {"format": FORMAT, "ir-sim": version("ir-sim"), "spec": spec}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _shards(pairs: dict[str, int]) -> Iterator[Shard]:
    for split, count in pairs.items():
        if count % 2 or count < 2:
            raise ValueError(f"pairs must be even and at least 2 (a world and its twin), got {split}={count}")
        for number, first in enumerate(range(0, count // 2, SHARD_WORLDS)):
            yield Shard(split, number, SPLITS[split] + first, min(SHARD_WORLDS, count // 2 - first))


def _write_shard(directory: Path, shard: Shard, spec: dict[str, Any], verify_every: int) -> int:
    """Records one shard in a worker process; returns its number of worlds."""
    runs: list[Recording] = []
    for seed in range(shard.first_seed, shard.first_seed + shard.worlds):
        world = sample_world(spec, seed)
        for item in (world, turn_around(world)):
            runs.append(record(item))
            if seed % verify_every == 0:
                check_replay(item, runs[-1])
    worlds = runs[::2]
    most = max(len(run.seen) for run in runs)
    arrays: dict[str, Any] = {
        "ranges": np.stack([run.ranges for run in runs]).astype(np.float32),
        "angles": runs[0].angles,
        "poses": np.stack([run.poses for run in runs]),
        "outlines": np.concatenate([_widen(run.outlines, runs) for run in worlds]).astype(np.float32),
        "states": np.concatenate([run.states for run in worlds]).astype(np.float32),
        "world": np.repeat(np.arange(len(worlds)), [len(run.seen) for run in worlds]),
        "seen": np.stack([np.pad(run.seen, (0, most - len(run.seen))) for run in runs]),
        "fingerprint": np.array(spec_fingerprint(spec)),
    }
    with tempfile.NamedTemporaryFile(dir=directory, suffix=".tmp", delete=False) as file:
        try:
            np.savez_compressed(file, **arrays)
        except BaseException:
            os.unlink(file.name)
            raise
    os.replace(file.name, directory / shard.name)
    return shard.worlds


def _widen(outlines: np.ndarray, runs: list[Recording]) -> np.ndarray:
    """Gives outlines as many vertices as the longest of the shard."""
    longest = max(run.outlines.shape[1] for run in runs)
    return np.pad(outlines, ((0, 0), (0, longest - outlines.shape[1]), (0, 0)), mode="edge")


def _read(path: Path, fingerprint: str) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"shard {path} cannot be read ({error}): delete it and record again") from error
    if str(arrays.pop("fingerprint", "")) != fingerprint:
        raise ValueError(
            f"shard {path} was recorded with another configuration: delete {path.parent} or use another outputs"
        )
    return arrays


def _check_same(directory: Path, manifest: dict, fingerprint: str, pairs: dict[str, int]) -> None:
    if manifest["fingerprint"] != fingerprint or manifest["pairs"] != dict(pairs):
        raise ValueError(
            f"{directory} holds {manifest['pairs']} pairs of another configuration than the {dict(pairs)} asked "
            "for: delete it or use another outputs"
        )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
