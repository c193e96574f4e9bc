import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import ROOT, world_spec

from repro.simulation import store
from repro.simulation.recording import record
from repro.simulation.store import (
    read_manifest,
    read_shards,
    record_experiment,
    recordings_hash,
    spec_fingerprint,
)
from repro.simulation.worlds import sample_world, turn_around

PAIRS = {"train": 8, "val": 4, "test": 4}


@pytest.fixture
def copy(recorded, tmp_path):
    directory = tmp_path / "laptop" / "recordings" / "exp3"
    shutil.copytree(recorded, directory)
    return directory


def test_what_is_read_is_what_was_simulated(recorded):
    shard = next(read_shards(recorded, "test"))
    assert shard["ranges"].shape == (8, 100, 100)
    for number in range(4):
        world = sample_world(world_spec("3"), store.SPLITS["test"] + number)
        mine = shard["world"] == number
        for twin, item in enumerate((world, turn_around(world))):
            run, stored = record(item), 2 * number + twin
            assert np.array_equal(shard["ranges"][stored], run.ranges.astype(np.float32))
            assert np.array_equal(shard["poses"][stored], run.poses)
            assert np.array_equal(shard["seen"][stored, : len(run.seen)], run.seen)
            assert np.array_equal(shard["states"][mine], run.states.astype(np.float32))


def test_content_does_not_depend_on_workers(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "SHARD_WORLDS", 1)
    manifests = [
        record_experiment(tmp_path / str(workers), world_spec("4"), PAIRS, workers=workers) for workers in (1, 2)
    ]
    assert len(manifests[0]["shards"]) == 8
    assert manifests[0] == manifests[1]


def test_splits_have_disjoint_seeds_and_twins_stay_together(recorded):
    seeds = [
        set(range(entry["first_seed"], entry["first_seed"] + entry["worlds"]))
        for entry in read_manifest(recorded)["shards"].values()
    ]
    assert sum(map(len, seeds)) == len(set.union(*seeds))
    for split, runs in (("train", 24), ("val", 8), ("test", 8)):
        for shard in read_shards(recorded, split):
            assert len(shard["ranges"]) == runs
            assert shard["world"].max() + 1 == runs // 2


def test_recording_again_changes_nothing(copy):
    before = {path.name: path.stat().st_mtime_ns for path in copy.glob("*.npz")}
    record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    (copy / "manifest.json").unlink()
    record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    assert {path.name: path.stat().st_mtime_ns for path in copy.glob("*.npz")} == before


def test_a_lost_shard_is_recorded_again_to_the_same_bytes(copy):
    manifest = read_manifest(copy)
    (copy / "manifest.json").unlink()
    (copy / "val-0000.npz").unlink()
    assert record_experiment(copy, world_spec("3"), manifest["pairs"], workers=1) == manifest


@pytest.mark.parametrize("damage", ["truncated", "altered", "missing"])
def test_a_damaged_shard_is_named_and_never_read(copy, damage):
    path = copy / "train-0000.npz"
    content = path.read_bytes()
    if damage == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "altered":
        path.write_bytes(content[:5000] + bytes([content[5000] ^ 1]) + content[5001:])
    else:
        path.unlink()
    with pytest.raises(ValueError, match=r"train-0000\.npz is"):
        next(read_shards(copy, "train"))


def test_a_truncated_shard_is_named_when_recording_goes_on(copy):
    (copy / "manifest.json").unlink()
    path = copy / "train-0000.npz"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"train-0000\.npz cannot be read"):
        record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)


@pytest.mark.parametrize("stage", ["finished", "unfinished"])
def test_another_configuration_is_refused(copy, stage):
    if stage == "unfinished":
        (copy / "manifest.json").unlink()
    with pytest.raises(ValueError, match="another configuration"):
        record_experiment(copy, world_spec("1"), {"train": 24, "val": 8, "test": 8}, workers=1)


def test_missing_recordings_name_the_command(tmp_path):
    with pytest.raises(ValueError, match="task=record scale=laptop exp=2"):
        recordings_hash(tmp_path / "laptop" / "recordings" / "exp2")


def test_odd_counts_are_refused(tmp_path):
    with pytest.raises(ValueError, match="even"):
        record_experiment(tmp_path, world_spec("1"), {"train": 3}, workers=1)


def test_fingerprint_follows_every_parameter():
    spec = world_spec("3")
    changed = json.loads(json.dumps(spec))
    changed["obstacles"]["behavior"]["speed_m_s"][1] += 0.1
    assert spec_fingerprint(spec) != spec_fingerprint(changed)
    assert spec_fingerprint(spec) != spec_fingerprint({**spec, "experiment": "4"})


def test_a_full_disk_leaves_only_whole_shards(tmp_path, monkeypatch):
    save, calls = np.savez_compressed, []

    def save_until_full(file, **arrays):
        calls.append(file)
        if len(calls) == 3:
            file.write(b"half of a shard")
            raise OSError(28, "No space left on device")
        save(file, **arrays)

    monkeypatch.setattr(store, "SHARD_WORLDS", 1)
    monkeypatch.setattr(np, "savez_compressed", save_until_full)
    with pytest.raises(OSError, match="No space left"):
        record_experiment(tmp_path, world_spec("1"), PAIRS, workers=1)
    assert {path.name for path in tmp_path.iterdir()} == {"train-0000.npz", "train-0001.npz", ".lock"}
    monkeypatch.setattr(np, "savez_compressed", save)
    record_experiment(tmp_path, world_spec("1"), PAIRS, workers=1)
    assert sum(len(shard["ranges"]) for shard in read_shards(tmp_path, "train")) == 8


def _record(directory, results):
    results.put(record_experiment(directory, world_spec("1"), PAIRS, workers=1))


def test_two_processes_record_one_experiment_together(tmp_path):
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    processes = [context.Process(target=_record, args=(tmp_path, results)) for _ in range(2)]
    for process in processes:
        process.start()
    first, second = results.get(timeout=120), results.get(timeout=120)
    for process in processes:
        process.join()
    assert first == second
    assert len(list(tmp_path.glob("*.npz"))) == 3
    assert not list(tmp_path.glob("*.tmp"))


def test_killed_while_recording_what_is_there_is_whole_and_the_next_call_goes_on(tmp_path, monkeypatch):
    directory = tmp_path / "rec"
    code = (
        "import sys; sys.path.insert(0, 'tests')\n"
        "from pathlib import Path; from conftest import world_spec; from repro.simulation import store\n"
        "store.SHARD_WORLDS = 2\n"
        f"store.record_experiment(Path({str(directory)!r}), world_spec('2'), {{'train': 400}}, workers=1)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, start_new_session=True)
    deadline = time.monotonic() + 60
    while len(list(directory.glob("train-*.npz"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    shards = sorted(directory.glob("train-*.npz"))
    assert 3 <= len(shards) < 100
    assert not (directory / "manifest.json").exists()
    for path in shards:
        store._read(path, spec_fingerprint(world_spec("2")))
    monkeypatch.setattr(store, "SHARD_WORLDS", 2)
    (directory / "half.tmp").write_bytes(b"half of a shard")
    record_experiment(directory, world_spec("2"), {"train": 400}, workers=2)
    assert sum(len(shard["ranges"]) for shard in read_shards(directory, "train")) == 400
    assert not list(directory.glob("*.tmp"))
