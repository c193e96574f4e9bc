"""Files from someone else: nothing that is read may run code. Ruff's S301 and S506 refuse readers that could."""

import io
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import prepared, spent_budget

from repro.learning.training import train
from repro.runs.provenance import Status
from repro.system.arrays import open_arrays

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


def test_the_marker_works(tmp_path):
    pickle.loads(pickle.dumps(Planted(tmp_path / "executed")))  # noqa: S301
    assert (tmp_path / "executed").is_dir()


@pytest.mark.parametrize("wrapped", [False, True], ids=["a pickle", "a checkpoint"])
def test_checkpoints(recorded, tmp_path, marker, wrapped):
    run = prepared(tmp_path / "run", model="fpn", max_epochs=3)
    assert train(run, recorded, accelerator="cpu", budget=spent_budget()) is Status.paused
    for path in (run.path / "checkpoints").iterdir():
        if wrapped:
            torch.save(torch.load(path, weights_only=True) | {"planted": Planted(marker)}, path)
        else:
            path.write_bytes(pickle.dumps(Planted(marker)))
    assert train(run, recorded, accelerator="cpu") is Status.trained  # from the beginning


def test_arrays(tmp_path, marker):
    """Of logs, shards and predictions."""
    buffer = io.BytesIO()
    np.save(buffer, np.array([Planted(marker)], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("ranges.npy", buffer.getvalue())
    with open_arrays(tmp_path / "a.npz") as arrays, pytest.raises(ValueError, match="allow_pickle=False"):
        arrays["ranges"]


def test_yaml(tmp_path, marker):
    run = prepared(tmp_path / "run")
    (run.path / "config.yaml").write_text(f"experiment: !!python/object/apply:os.mkdir ['{marker}']\n")
    with pytest.raises(ValueError, match="cannot be read"):
        run.config()
