"""Files from someone else: nothing that is read may run code."""

import io
import json
import os
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import prepared, spent_budget

from repro.evaluation.evaluate import evaluate, read_per_image, read_quantized
from repro.learning.training import train
from repro.networks.predictor import load_predictor
from repro.prediction.readers import read_log
from repro.prediction.times import WindowSettings
from repro.recordings.reader import read_manifest, read_shards
from repro.reporting.results import read_published
from repro.runs.directories import Run
from repro.runs.provenance import Status
from repro.system.files import sha256

pytestmark = pytest.mark.slow


class Planted:
    """An object that creates a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.fixture
def marker(tmp_path):
    """A directory that planted code would create."""
    path = tmp_path / "executed"
    yield path
    assert not path.exists(), "planted code was executed"


def pickled(marker: Path) -> bytes:
    return pickle.dumps(Planted(marker))


def npz_with_code(path: Path, name: str, marker: Path) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.array([Planted(marker)], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{name}.npy", buffer.getvalue())


@pytest.fixture(scope="module")
def evaluated(recorded, tmp_path_factory) -> Path:
    run = prepared(tmp_path_factory.mktemp("evaluated") / "run", model="fpn", max_epochs=1)
    train(run, recorded, accelerator="cpu")
    evaluate(run, recorded, accelerator="cpu")
    return run.path


@pytest.fixture
def run(evaluated, tmp_path) -> Run:
    return Run(Path(shutil.copytree(evaluated, tmp_path / "run")))


def test_the_marker_works(tmp_path):
    pickle.loads(pickled(tmp_path / "executed"))
    assert (tmp_path / "executed").is_dir()


@pytest.mark.parametrize("wrapped", [False, True], ids=["a pickle", "a checkpoint"])
def test_checkpoints(recorded, tmp_path, marker, wrapped):
    run = prepared(tmp_path / "run", model="fpn", max_epochs=3)
    assert train(run, recorded, accelerator="cpu", budget=spent_budget()) is Status.paused
    for path in (run.path / "checkpoints").iterdir():
        if wrapped:
            torch.save(torch.load(path, weights_only=True) | {"planted": Planted(marker)}, path)
        else:
            path.write_bytes(pickled(marker))
    assert train(run, recorded, accelerator="cpu") is Status.trained  # from the beginning


PICKLED = {  # files of a run: how they are read, and the error
    "model/model.safetensors": (lambda run: load_predictor(run.model), "differs from its checksum"),
    "model/config.json": (lambda run: load_predictor(run.model), "restore|must be written by"),
    "model/predictor.json": (lambda run: load_predictor(run.model), "restore|must be written by"),
    "per_image.csv": (read_per_image, "is not what was evaluated"),
    "config.yaml": (Run.config, "cannot be read"),
    "provenance.json": (Run.provenance, "cannot be read"),
}


@pytest.mark.parametrize("name", PICKLED)
def test_a_pickle_instead_of_a_file_of_a_run(run, marker, name):
    read, problem = PICKLED[name]
    (run.path / name).write_bytes(pickled(marker))
    with pytest.raises(ValueError, match=problem):
        read(run)


def test_weights_of_another_format(run, marker):
    (run.model / "pytorch_model.bin").write_bytes(pickled(marker))
    (run.model / "model.safetensors").unlink()
    with pytest.raises(ValueError, match=r"lacks model\.safetensors"):
        load_predictor(run.model)


def test_yaml_with_code(run, marker):
    (run.path / "config.yaml").write_text(f"experiment: !!python/object/apply:os.mkdir ['{marker}']\n")
    with pytest.raises(ValueError, match="cannot be read"):
        run.config()


def test_predictions(run, marker):
    npz_with_code(run.path / "predictions.npz", "free", marker)
    with pytest.raises(ValueError, match="is not what was evaluated"):
        read_quantized(run)
    provenance = json.loads((run.path / "provenance.json").read_text())
    provenance["steps"][-1]["files"]["predictions.npz"] = sha256(run.path / "predictions.npz")
    (run.path / "provenance.json").write_text(json.dumps(provenance))
    with pytest.raises(ValueError, match="cannot be read"):
        read_quantized(run)


def test_shards(recorded, tmp_path, marker):
    copy = Path(shutil.copytree(recorded, tmp_path / "recordings"))
    shard = copy / "test-0000.npz"
    for name in ("ranges", "fingerprint"):
        npz_with_code(shard, name, marker)
        with pytest.raises(ValueError, match="is not what was recorded"):
            next(read_shards(copy, "test"))
        manifest = json.loads((copy / "manifest.json").read_text())
        manifest["shards"][shard.name]["sha256"] = sha256(shard)
        (copy / "manifest.json").write_text(json.dumps(manifest))
        with pytest.raises(ValueError, match="cannot be read"):
            next(read_shards(copy, "test"))


def test_manifests(recorded, tmp_path, marker):
    copy = Path(shutil.copytree(recorded, tmp_path / "recordings"))
    (copy / "manifest.json").write_bytes(pickled(marker))
    with pytest.raises(ValueError, match="cannot be read"):
        read_manifest(copy)


@pytest.mark.parametrize("name", ["ranges", "stamps", "range_max_m"])
def test_logs(tmp_path, marker, name):
    arrays = {"ranges": np.ones((5, 3)), "angles": np.linspace(-1, 1, 3), "poses": np.zeros((5, 3))}
    arrays |= {"stamps": np.arange(5.0), "range_max_m": np.array(30.0)}
    del arrays[name]
    npz_with_code(tmp_path / "log.npz", name, marker)
    with zipfile.ZipFile(tmp_path / "log.npz", "a") as archive:
        for other, array in arrays.items():
            with archive.open(f"{other}.npy", "w") as file:
                np.save(file, array)
    with pytest.raises(ValueError, match=f"{name}: expected real numbers, got object"):
        read_log(tmp_path / "log.npz", WindowSettings())


def test_published_results(tmp_path, marker):
    (tmp_path / "laptop").mkdir()
    (tmp_path / "laptop" / "runs.csv").write_bytes(pickled(marker))
    with pytest.raises((ValueError, UnicodeDecodeError)):
        read_published(tmp_path / "laptop")
