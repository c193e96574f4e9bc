"""task=predict in this process, with a small network."""

import json
import os
import shutil
import uuid
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from conftest import ROOT
from log_files import SCANS, STAMPS, carmen, flaser

from repro.cli import log_prediction
from repro.cli.settings import Prediction
from repro.cli.tasks.predict import target_of
from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.predictor import Predictor
from repro.runs.model import paper_model
from repro.system.errors import InputError

EXAMPLE = ROOT / "examples" / "rooms.npz"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that predicts a log to `tmp_path`."""
    torch.manual_seed(0)
    predictor = Predictor(TorchNetwork(create_network(paper_model("fpn"))), Projection(), Grid(32, 50.0))
    monkeypatch.setattr(log_prediction, "load", lambda path: predictor)

    def call(scans: Path | list[Path] = EXAMPLE, **changes: object) -> None:
        scans = scans if isinstance(scans, list) else [scans]
        settings = {"weights": str(ROOT), "steps": 10, "step_s": 0.1, "stride_s": 5.0, "center": "robot"}
        settings |= dict.fromkeys(("pose", "mounting", "frame"), None) | {"spacing": None}
        settings |= {"fov_deg": None, "range_max_m": None, "misses": "free", "scan_topic": None, "odometry_topic": None}
        chosen = Prediction(**settings | changes)
        job = SimpleNamespace(
            call=SimpleNamespace(prediction=chosen, scans=[*map(str, scans)]), outputs=SimpleNamespace(path=tmp_path)
        )
        log_prediction.predict_log(job, target_of(job))  # type: ignore[arg-type]

    return call


def test_windows_that_are_left_out_are_counted(run, capsys):
    with pytest.raises(ValueError, match="none of its 6 windows or parts can be used, see above"):
        run(center=(1000.0, 1000.0))
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("left out")]
    assert "6 windows or parts, such as window 1 at 0.9 s: 1 of 1 windows are of a robot that is outside" in lines[0]


@pytest.mark.parametrize("name", ["notes.txt", "other.mcap", "window-9999.txt", "window-1.png", ""])
def test_a_directory_with_other_files_or_a_file_in_its_place_is_not_replaced(run, tmp_path, name):
    target = tmp_path / "predictions" / "rooms" / name
    target.parent.mkdir(parents=True)
    target.write_text("mine")
    with pytest.raises(ValueError, match=rf"rooms is replaced .* such as {target.name}: move them"):
        run()
    assert target.read_text() == "mine"


def test_a_log_or_weights_in_the_place_of_the_predictions_are_kept(run, tmp_path):
    directory = tmp_path / "predictions" / "rooms"
    directory.mkdir(parents=True)
    (directory / "rooms.mcap").write_bytes(b"")
    for given in ({"scans": directory / "rooms.mcap"}, {"weights": str(directory)}):
        with pytest.raises(ValueError, match=r"rooms.* is in .*rooms, which the prediction replaces: move it"):
            run(**given)
    assert (directory / "rooms.mcap").is_file()


def test_misses_at_an_unknown_maximum_range_are_named(run, tmp_path, capsys):
    log = dict(np.load(EXAMPLE))
    del log["range_max_m"]
    np.savez(tmp_path / "log.npz", **log | {"ranges": np.minimum(log["ranges"], 15.0)})
    run(tmp_path / "log.npz")
    count = (log["ranges"] >= 15).sum()
    assert f"{count} readings are exactly 15.0 m, which looks like the maximum range" in capsys.readouterr().out
    run(tmp_path / "log.npz", range_max_m=15.0)
    assert "looks like" not in capsys.readouterr().out


def test_earlier_predictions_and_what_a_killed_one_left_are_replaced(run, tmp_path):
    """Not what it left of another log, which may be predicted at the same time."""
    directory = tmp_path / "predictions"
    ours, other = (directory / f"{name}.{uuid.uuid4().hex}.tmp" for name in ("rooms", "other"))
    for leftover in (ours, other):
        leftover.mkdir(parents=True)
        (leftover / "window-0001.npz").touch()
    for _ in range(2):
        run(center=(12.5, 12.5))
    assert not ours.exists()
    assert other.exists()
    assert set(os.listdir(directory)) == {"rooms", ".rooms.lock", other.name}
    source = json.loads((directory / "rooms" / "source.json").read_text())
    assert source.items() >= {"log": [str(EXAMPLE)], "weights": str(ROOT), "steps": 10, "fov_deg": None}.items()


def test_a_map_without_obstacles_is_worse_than_the_last_hits_on_the_next_scan_and_on_held_out_beams(
    run, tmp_path, capsys, monkeypatch
):
    predict = log_prediction.predict_map
    monkeypatch.setattr(log_prediction, "predict_map", lambda *args: replace(predict(*args), free=np.ones((32, 32))))
    run(fov_deg=45.0)
    table, printed = pd.read_csv(tmp_path / "predictions" / "rooms" / "windows.csv"), capsys.readouterr().out
    for name, scan in (("next_scan", "next scan"), ("held_out", "held-out beams")):
        ours, others = (table[f"{name}_{loss}"].mean() for loss in ("log_loss", "last_hits_log_loss"))
        assert ours > 1.5 * others > 0
        assert f"{scan}: log loss {ours:.3f}, worse than {others:.3f} of the last hits" in printed
    run()
    assert not [name for name in pd.read_csv(tmp_path / "predictions" / "rooms" / "windows.csv") if "held" in name]


def test_a_linked_directory_stays_a_link(run, tmp_path):
    elsewhere, predictions = tmp_path / "elsewhere", tmp_path / "predictions"
    elsewhere.mkdir()
    predictions.mkdir()
    (predictions / "rooms").symlink_to(elsewhere)
    for _ in range(2):
        run()
    assert (predictions / "rooms").is_symlink()
    assert (elsewhere / "windows.csv").is_file()
    assert [path.name for path in (*tmp_path.iterdir(), *predictions.iterdir()) if path.suffix == ".tmp"] == []


def test_a_carmen_log_without_usable_times_is_spaced_by_distance(run, tmp_path, capsys):
    same = [flaser(number).replace(f"{STAMPS[number]:.6f}", "0.000000") for number in range(SCANS)]
    path = carmen(tmp_path / "log", same)
    with pytest.raises(InputError, match="no statistics"):  # of the network here; before, the times were refused
        run(path, step_s=None)
    assert "prediction.spacing=distance is taken: 29 scans are not later" in capsys.readouterr().out
    with pytest.raises(InputError, match="its times are lost"):
        run(path, spacing="time")


def test_several_files_are_one_log(run, tmp_path):
    whole = np.load(EXAMPLE)
    names = []
    for part in (slice(0, 150), slice(150, 300)):
        cut = {name: whole[name][part] if name in ("ranges", "poses", "stamps") else whole[name] for name in whole}
        names.append(tmp_path / f"part{len(names)}.npz")
        np.savez(names[-1], **cut)
    run(names)
    run()
    tables = [pd.read_csv(tmp_path / "predictions" / name / "windows.csv") for name in ("part0-and-1-others", "rooms")]
    pd.testing.assert_frame_equal(*tables)


def test_maps_of_another_log_of_the_same_name_are_not_replaced(run, tmp_path):
    for day in ("one", "two"):
        (tmp_path / day).mkdir()
        shutil.copy(EXAMPLE, tmp_path / day / "log.npz")
    for _ in range(2):
        run(tmp_path / "one" / "log.npz")  # again, from the same file
    with pytest.raises(ValueError, match=r"predictions/log has the maps of .*one/log\.npz: delete it, or set outputs="):
        run(tmp_path / "two" / "log.npz")
