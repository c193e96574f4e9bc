from dataclasses import replace

import pytest

from repro.config import Encoding, PairCounts, Training
from repro.learning import cost
from repro.learning.cost import training_seconds
from repro.networks.model import Model, paper_model
from repro.runs.config import Data, RunConfig

PAIRS = PairCounts(10000, 128, 500)
TRAINING = Training(learning_rate=1e-4, min_delta=1e-3, patience=5, batch_size=2, max_epochs=100, dice_eps=1e-6)
PAPER = RunConfig("4", 0, paper_model("unet"), Encoding("projection", {}), Data("paper", 32, 50.0, PAIRS, ""), TRAINING)


def test_a_recurrent_network_is_measured_with_its_series(monkeypatch):
    calls = []
    monkeypatch.setattr(cost, "seconds_per_image", lambda *given: calls.append(given) or 0.001)
    series = Encoding("series4", {"frames": 4, "range_max_m": 30.0})
    config = replace(PAPER, model=Model("convgru"), encoding=series, train=replace(TRAINING, max_epochs=5))
    assert training_seconds(config, "32-true", "cpu") == pytest.approx(0.001 * 10000 * 5)
    ((model, encoding, *numbers, accelerator),) = calls
    assert (model, encoding.channels, encoding.frames, accelerator) == (Model("convgru"), 8, 4, "cpu")
    assert numbers == [32, 2, "32-true", 8]
