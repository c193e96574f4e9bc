from dataclasses import asdict

import pytest
from conftest import ROOT, fake_run, run_config

from repro.cli.study_plan import StudyPlan, describe_outputs
from repro.recordings.format import shards_of
from repro.reporting.names import duration
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY, PairCounts
from repro.runs.keys import RunKey
from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.worlds.spec import WorldFile, read_world

PAIRS = PairCounts(200, 4, 4)
EXPERIMENTS = WorldFile.parse(read_world(ROOT / "conf" / "world" / "paper.yaml")).experiments


def test_the_study_has_the_papers_24_trainings(tmp_path):
    keys = list(StudyPlan(Outputs(tmp_path), EXPERIMENTS, 0, {}).runs())
    ablation = [key for key in keys if key.encoding == PROJECTION_NO_DECAY]
    assert len(keys) == 24
    assert ablation == keys[16:]
    assert {key.experiment for key in ablation} == {"3", "4"}
    assert {key.model for key in keys} == set(NETWORKS)


def test_the_status_lists_the_state_of_every_run(tmp_path):
    outputs = Outputs(tmp_path)
    fake_run(tmp_path, "3", "unet", 0.9)
    fake_run(tmp_path, "3", "fpn", 0.9, seed=1, status=Status.paused)
    fake_run(tmp_path, "4", "unet", 0.9, decay=False, status=Status.failed)
    broken = fake_run(tmp_path, "4", "fpn", 0.9)
    (broken.path / "provenance.json").write_text("{")
    (broken.path.parent / "seed0-old").mkdir()
    fake_run(tmp_path, "3", "upernet", 0.9, worlds="others")
    fake_run(tmp_path, "3", "tracker", 0.9)
    waiting = outputs.run(RunKey("5", "unet", PROJECTION, 0)).path
    waiting.mkdir(parents=True)
    (waiting / "run.log").touch()  # it waits for its recordings
    directory = outputs.recordings("3")
    directory.mkdir(parents=True)
    (directory / "train-0000.npz").touch()
    outputs.recordings("4").mkdir(parents=True)
    for shard in shards_of(asdict(PAIRS)):
        (outputs.recordings("4") / shard.name).touch()
    experiments = {name: EXPERIMENTS[name] for name in "34"} | {"5": EXPERIMENTS["1"]}
    text = describe_outputs(StudyPlan(outputs, experiments, 0, {"3": run_config().data.worlds}), PAIRS)
    for row in (
        "| 3 | 100 of 208 |",
        "| 4 | 208 of 208 |",
        "| 5 | 0 of 208 |",
        "| runs/exp3/unet/projection/seed0 | evaluated |",
        "| runs/exp3/fpn/projection/seed1 | paused |",
        "| runs/exp3/upernet/projection/seed0 | of another world |",
        "| baselines/exp3/tracker | evaluated |",
        "| runs/exp4/unet/projection-no-decay/seed0 | failed |",
        "| runs/exp4/fpn/projection/seed0 | cannot be read |",
    ):
        assert row in text, text
    assert "| missing |" not in text
    assert "Of the study's 20 trainings with seed 0: 16 missing" in text
    assert "Missing: 3 of U-Net, 4 of FPN, 4 of UPerNet, 5 of Segformer." in text
    assert "1 of another world" in text
    assert "seed0-old is passed over: its name is not that of a run" in text


def test_a_training_that_no_process_runs_is_stopped(tmp_path):
    run = fake_run(tmp_path, "3", "fpn", 0.9, status=Status.training)
    study = StudyPlan(Outputs(tmp_path), {"3": EXPERIMENTS["3"]}, 0, {})
    assert "/fpn/projection/seed0 | stopped |" in describe_outputs(study, PAIRS)
    with run.exclusive():
        assert "/fpn/projection/seed0 | training |" in describe_outputs(study, PAIRS)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0 s"), (89, "89 s"), (90, "2 min"), (7199, "120 min"), (7200, "2 h")]
)
def test_durations_are_readable(seconds, text):
    assert duration(seconds) == text
