import pytest
from conftest import fake_run

from repro.config import PairCounts
from repro.reporting.status import describe_outputs
from repro.reporting.study import CELLS, Study
from repro.runs.directories import Outputs
from repro.runs.provenance import Status

PAIRS = PairCounts(200, 4, 4)


def test_the_study_has_the_papers_24_trainings():
    assert len(set(CELLS)) == 24
    assert [cell for cell in CELLS if cell[2] == "no-decay"] == CELLS[16:]
    assert {experiment for experiment, _, variant in CELLS if variant == "no-decay"} == {"3", "4"}


def test_a_training_knows_its_place_and_what_is_left(tmp_path):
    study = Study(Outputs(tmp_path), 0)
    first = study.runs()["3", "fpn", "decay"]
    assert study.place(first) == "training 1 of 24: exp 3, FPN"
    assert study.seconds_left() is None
    fake_run(tmp_path, "3", "unet", 0.9)  # took a second
    assert study.seconds_left() == pytest.approx(23)
    place = study.place(study.runs()["4", "fpn", "no-decay"])
    assert (
        place == "training 2 of 24: exp 4, FPN, no decay; 0 min of training behind it, about 0 left, as measured so far"
    )
    assert study.place(Outputs(tmp_path).run("3", "unet", "observed_free", 0)) is None


def test_what_stands_where_is_said_for_every_run(tmp_path):
    outputs = Outputs(tmp_path)
    fake_run(tmp_path, "3", "unet", 0.9)
    fake_run(tmp_path, "3", "fpn", 0.9, seed=1, status=Status.paused)
    (outputs.run("3", "fpn", "decay", 1).path / "history.csv").write_text("epoch,train_loss\n0,1\n1,0.5\n")
    fake_run(tmp_path, "4", "unet", 0.9, decay=False, status=Status.failed)
    broken = fake_run(tmp_path, "4", "fpn", 0.9)
    (broken.path / "provenance.json").write_text("{")
    lost = fake_run(tmp_path, "3", "segformer", 0.9)
    lost.metrics.unlink()
    directory = outputs.recordings("3")
    directory.mkdir(parents=True)
    (directory / "train-0000.npz").touch()
    (outputs.recordings("4") / "manifest.json").parent.mkdir(parents=True)
    (outputs.recordings("4") / "manifest.json").touch()
    text = describe_outputs(outputs, ["3", "4", "5"], PAIRS, 0)
    for row in (
        "| 3 | 100 of 208 |",
        "| 4 | complete |",
        "| 5 | missing |",
        "| 3 | U-Net | decay | evaluated |  |",
        "| 3 | FPN | decay | missing | paused, 2 epochs |",
        "| 3 | Segformer | decay | evaluated, metrics missing |  |",
        "| 4 | U-Net | no-decay | failed |  |",
        "| 4 | FPN | decay | cannot be read |  |",
    ):
        assert row in text, text
    assert "Of the study's 24 trainings with seed 0: 20 missing" in text
    assert "min of training remain" in text
