import pytest
from conftest import read_calls

from repro.cli import plan
from repro.cli.jobs import Job, resolve
from repro.cli.plan import seconds_left
from repro.cli.study import Study
from repro.learning import cost

RECORDINGS = 4 * 10628 * 100 * 100 * 2e-6  # of four experiments, 100 steps and 100 beams


@pytest.fixture
def job(tmp_path) -> Job:
    small = ("scale.size_px=64", "scale.batch_size=2", "runtime.accelerator=cpu", "runtime.workers=1")
    (call,) = read_calls("task=plan", "exp=4", "scale=paper", f"outputs={tmp_path}", *small)
    return resolve(call)


def test_the_rest_of_a_study_is_recorded_trained_evaluated_and_compared(job, monkeypatch):
    monkeypatch.setattr(plan, "PREDICTORS", {"a": None})
    monkeypatch.setattr(plan, "applies", lambda *_: True)
    monkeypatch.setattr(plan, "training_seconds", lambda config, *_: {"unet": 100.0}.get(config.model.name, 0.0))
    monkeypatch.setattr(plan, "parallel_trainings", lambda *_: 2)
    trainings = 6 * 100.0 / 2
    baselines = 4 * plan.BASELINE_SECONDS * 628
    assert seconds_left(job) == pytest.approx(RECORDINGS + trainings + 24 * (2.0 + 3.0) + baselines)


def test_one_training_is_not_divided_among_cores(job, monkeypatch):
    monkeypatch.setattr(plan, "PREDICTORS", ())
    monkeypatch.setattr(plan, "training_seconds", lambda *_: 36000.0)
    monkeypatch.setattr(plan, "parallel_trainings", lambda *_: 8)
    first = next(iter(job.study.runs().items()))
    monkeypatch.setattr(Study, "runs", lambda self: dict([first]))
    assert seconds_left(job) == pytest.approx(RECORDINGS + 36000 + 5)


def test_a_finished_study_is_not_measured(job, monkeypatch):
    monkeypatch.setattr(plan, "PREDICTORS", ())
    monkeypatch.setattr(plan, "recordings_in", lambda _, wanted: sum(wanted.values()))
    monkeypatch.setattr(Study, "runs", lambda self: {})
    monkeypatch.setattr(cost, "seconds_per_image", None)
    assert seconds_left(job) == 0
