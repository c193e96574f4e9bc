import pytest
from conftest import read_calls

from repro.cli import plan
from repro.cli.jobs import Job, resolve
from repro.cli.plan import Left, plan_study
from repro.learning import cost
from repro.networks.model import NETWORKS

NOTHING = dict.fromkeys(NETWORKS, 0)


@pytest.fixture
def job() -> Job:
    small = ("scale.size_px=32", "scale.batch_size=2", "runtime.accelerator=cpu", "runtime.precision=32-true")
    (call,) = read_calls("task=plan", "exp=4", "scale=paper", *small)
    return resolve(call)


@pytest.mark.slow
def test_plan_lists_recordings_trainings_evaluations_and_the_total(job):
    trainings = {"unet": 6, "fpn": 0, "upernet": 1, "segformer": 2}
    text = "\n".join(plan_study(job, Left(1000, 12.0, trainings, 9, 40)))
    assert "1000 recordings: 12 s" in text
    assert all(part in text for part in ("6 x unet: ", "fpn: done", "1 x upernet: ", "2 x segformer: "))
    assert "evaluation and analysis of 9 runs: 45 s" in text
    assert "40 classical baselines, which task=analysis evaluates: 2 min" in text
    assert "on idle cores, at 20 epochs a training" in text


def test_one_training_is_not_divided_among_cores(job, monkeypatch):
    monkeypatch.setattr(plan, "training_seconds", lambda *_: 36000.0)
    monkeypatch.setattr(plan, "parallel_trainings", lambda *_: 8)
    text = "\n".join(plan_study(job, Left(0, 0.0, NOTHING | {"unet": 1}, 0, 0)))
    assert "About 10 h on idle cores" in text
    assert "at the same time" not in text


def test_a_finished_study_is_not_measured(job, monkeypatch):
    monkeypatch.setattr(cost, "seconds_per_image", None)
    assert [line.strip() for line in plan_study(job, Left(0, 0.0, NOTHING, 0, 0))] == [
        "recordings: done",
        *(f"{name}: done" for name in NETWORKS),
    ]
