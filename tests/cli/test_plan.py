from types import SimpleNamespace
from typing import Any

import pytest

from repro.cli import plan
from repro.cli.plan import plan_study
from repro.config import Encoding, PairCounts, Training
from repro.learning import cost
from repro.networks.model import NETWORKS, paper_model
from repro.runs.config import Data, RunConfig

PAIRS = PairCounts(10000, 128, 500)
TRAINING = Training(learning_rate=1e-4, min_delta=1e-3, patience=5, batch_size=2, max_epochs=100, dice_eps=1e-6)
PAPER = RunConfig("4", 0, paper_model("unet"), Encoding("projection", {}), Data("paper", 32, 50.0, PAIRS, ""), TRAINING)
RUNTIME: Any = SimpleNamespace(accelerator="cpu", precision="32-true")


@pytest.mark.slow
def test_plan_lists_recordings_trainings_evaluations_and_the_total():
    trainings = {"unet": 6, "fpn": 0, "upernet": 1, "segformer": 2}
    text = "\n".join(plan_study(PAPER, RUNTIME, 1000, 12.0, trainings, 9, 40))
    assert "1000 recordings: 12 s" in text
    assert all(part in text for part in ("6 x unet: ", "fpn: done", "1 x upernet: ", "2 x segformer: "))
    assert "evaluation and analysis of 9 runs: 45 s" in text
    assert "40 classical baselines, which task=analysis evaluates: 2 min" in text
    assert "on idle cores, at 20 epochs a training" in text


def test_one_training_is_not_divided_among_cores(monkeypatch):
    monkeypatch.setattr(plan, "training_seconds", lambda *_: 36000.0)
    monkeypatch.setattr(plan, "trainings_at_once", lambda *_: 8)
    text = "\n".join(plan_study(PAPER, RUNTIME, 0, 0.0, dict.fromkeys(NETWORKS, 0) | {"unet": 1}, 0, 0))
    assert "About 10 h on idle cores" in text
    assert "at the same time" not in text


def test_a_finished_study_is_not_measured(monkeypatch):
    monkeypatch.setattr(cost, "seconds_per_image", None)
    assert [line.strip() for line in plan_study(PAPER, RUNTIME, 0, 0.0, dict.fromkeys(NETWORKS, 0), 0, 0)] == [
        "recordings: done",
        *(f"{name}: done" for name in NETWORKS),
    ]
