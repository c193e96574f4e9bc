import shutil

import numpy as np
import pytest
from conftest import damage, world_spec

from repro.recordings import format
from repro.recordings.format import SPLITS, spec_fingerprint
from repro.recordings.reader import open_recordings
from repro.simulation import recorder
from repro.simulation.recorder import record_experiment, write_shard
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.simulator import simulate

PAIRS = {"train": 8, "val": 4, "test": 4}


@pytest.fixture(autouse=True)
def replayed(monkeypatch) -> list[dict]:
    """Replace the comparison with plain IR-SIM, which is slow and tested elsewhere; return the compared worlds."""
    worlds: list[dict] = []
    monkeypatch.setattr(recorder, "check_replay", lambda world, recording: worlds.append(world))
    return worlds


@pytest.fixture
def copy(recorded, tmp_path):
    directory = tmp_path / "laptop" / "recordings" / "exp3"
    shutil.copytree(recorded, directory)
    return directory


def test_recordings_are_those_of_the_simulation(recorded):
    shard = next(open_recordings(recorded).shards("test"))
    assert shard.scans.ranges.shape == (8, 100, 100)
    for number in range(4):
        world = sample_world(world_spec("3"), SPLITS["test"] + number)
        mine = shard.world == number
        for twin, item in enumerate((world, reverse_direction(world))):
            recording, stored = simulate(item), 2 * number + twin
            assert np.array_equal(shard.scans.ranges[stored], recording.scans.ranges.astype(np.float32))
            assert np.array_equal(shard.scans.poses[stored], recording.scans.poses)
            assert np.array_equal(shard.seen[stored, : len(recording.seen)], recording.seen)
            assert np.array_equal(shard.states[mine], recording.states.astype(np.float32))


@pytest.mark.slow
def test_recordings_do_not_depend_on_the_number_of_workers(tmp_path, monkeypatch):
    monkeypatch.setattr(format, "SHARD_WORLDS", 1)
    manifests = [
        record_experiment(tmp_path / str(workers), world_spec("4"), PAIRS, workers=workers) for workers in (1, 2)
    ]
    assert len(manifests[0].shards) == 8
    assert manifests[0] == manifests[1]


def test_splits_have_disjoint_seeds_and_twins_stay_together(recorded):
    seeds = [
        set(range(entry.first_seed, entry.first_seed + entry.worlds))
        for entry in open_recordings(recorded).manifest.shards.values()
    ]
    assert sum(map(len, seeds)) == len(set.union(*seeds))
    for split, count in (("train", 24), ("val", 8), ("test", 8)):
        for shard in open_recordings(recorded).shards(split):
            assert len(shard.scans) == count
            assert shard.world.max() + 1 == count // 2


def test_recording_again_changes_nothing(copy):
    before = {path.name: path.stat().st_mtime_ns for path in copy.glob("*.npz")}
    record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    (copy / "manifest.json").unlink()
    record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    assert {path.name: path.stat().st_mtime_ns for path in copy.glob("*.npz")} == before


@pytest.mark.parametrize("manifest", ["there", "not yet there"])
@pytest.mark.parametrize("how", ["cut", "altered", "missing"])
def test_a_damaged_shard_is_never_read_and_recorded_again_and_no_other(copy, how, manifest, capsys):
    path, other = copy / "train-0000.npz", copy / "test-0000.npz"
    before = open_recordings(copy).manifest
    content, untouched = path.read_bytes(), other.stat().st_mtime_ns
    damage(path, how)
    with pytest.raises(ValueError, match=r"train-0000\.npz is"):
        next(open_recordings(copy).shards("train"))
    if manifest == "not yet there":
        (copy / "manifest.json").unlink()
    assert record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1) == before
    assert path.read_bytes() == content
    assert other.stat().st_mtime_ns == untouched
    assert ("recording again: shard" in capsys.readouterr().out) == (how != "missing")


def test_a_damaged_manifest_is_named_with_a_fix(copy):
    path = copy / "manifest.json"
    text = path.read_text()
    damage(path, "cut")
    with pytest.raises(ValueError, match=r"manifest\.json cannot be read .*task=record"):
        open_recordings(copy)
    path.unlink()
    assert record_experiment(copy, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    assert path.read_text() == text


@pytest.mark.parametrize("stage", ["finished", "unfinished"])
def test_another_configuration_is_refused(copy, stage):
    if stage == "unfinished":
        (copy / "manifest.json").unlink()
    with pytest.raises(ValueError, match=r"other worlds|another configuration"):
        record_experiment(copy, world_spec("1"), {"train": 24, "val": 8, "test": 8}, workers=1)


def test_recordings_with_more_training_pairs_can_be_used_for_fewer(tmp_path, monkeypatch):
    monkeypatch.setattr(format, "SHARD_WORLDS", 2)
    fewer = PAIRS | {"train": 4}
    for pairs, name in ((PAIRS, "more"), (fewer, "fewer")):
        record_experiment(tmp_path / name, world_spec("3"), pairs, workers=1)
    kept = (tmp_path / "more" / "manifest.json").read_text()
    assert record_experiment(tmp_path / "more", world_spec("3"), fewer, workers=1).pairs == PAIRS
    assert (tmp_path / "more" / "manifest.json").read_text() == kept
    assert open_recordings(tmp_path / "more").hash(fewer) == open_recordings(tmp_path / "fewer").hash()
    assert open_recordings(tmp_path / "more").hash(PAIRS) == open_recordings(tmp_path / "more").hash()
    taken, whole = (
        [shard.scans.ranges for shard in open_recordings(tmp_path / name).shards("train", 4)]
        for name in ("more", "fewer")
    )
    assert np.array_equal(np.concatenate(taken), np.concatenate(whole))


@pytest.mark.parametrize(
    "asked",
    [PAIRS | {"train": 6}, PAIRS | {"train": 12}, PAIRS | {"test": 2}, {"train": 4}],
    ids=["not whole shards", "more", "other test pairs", "no test pairs"],
)
def test_recordings_of_other_sizes_are_refused(tmp_path, monkeypatch, asked):
    monkeypatch.setattr(format, "SHARD_WORLDS", 2)
    record_experiment(tmp_path, world_spec("3"), PAIRS, workers=1)
    with pytest.raises(ValueError, match=r"has .*'train': 8.* expected the same numbers"):
        record_experiment(tmp_path, world_spec("3"), asked, workers=1)
    with pytest.raises(ValueError, match=r"holds .*'train': 8.* do not cover the requested"):
        open_recordings(tmp_path).hash(asked)


def test_missing_recordings_name_the_command(tmp_path):
    with pytest.raises(ValueError, match=r"no complete recordings in .*same command with task=record"):
        open_recordings(tmp_path / "laptop" / "recordings" / "exp2").hash()


def test_odd_counts_are_refused(tmp_path):
    with pytest.raises(ValueError, match="even"):
        record_experiment(tmp_path, world_spec("1"), {"train": 3}, workers=1)


def test_the_fingerprint_depends_on_every_parameter():
    spec = world_spec("3")
    behavior = {**spec.raw["obstacles"]["behavior"], "speed_m_s": [0.2, 0.8]}
    changes = {"obstacles": {"behavior": behavior}}, {"experiment": "4"}, {"motion": {"turned_rad": 0.0}}
    assert len({spec_fingerprint(other) for other in (spec, *(world_spec("3", **change) for change in changes))}) == 4


def test_a_full_disk_leaves_complete_shards_only(tmp_path, monkeypatch):
    save, calls = np.savez_compressed, []

    def save_until_full(file, **arrays):
        calls.append(file)
        if len(calls) == 3:
            file.write(b"half of a shard")
            raise OSError(28, "No space left on device")
        save(file, **arrays)

    monkeypatch.setattr(format, "SHARD_WORLDS", 1)
    monkeypatch.setattr(np, "savez_compressed", save_until_full)
    with pytest.raises(OSError, match="No space left"):
        record_experiment(tmp_path, world_spec("1"), PAIRS, workers=1)
    assert {path.name for path in tmp_path.iterdir()} == {"train-0000.npz", "train-0001.npz", ".lock"}
    monkeypatch.setattr(np, "savez_compressed", save)
    record_experiment(tmp_path, world_spec("1"), PAIRS, workers=1)
    assert sum(len(shard.scans) for shard in open_recordings(tmp_path).shards("train")) == 8


def test_every_second_world_is_compared_with_its_replay(tmp_path, replayed):
    spec = world_spec("3")
    write_shard(tmp_path, format.Shard("train", 0, first_seed=1, worlds=4), spec, verify_every=2)
    worlds = [sample_world(spec, seed) for seed in (2, 4)]
    assert replayed == [item for world in worlds for item in (world, reverse_direction(world))]
