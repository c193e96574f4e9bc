"""Threads of a prediction by torch: those of compiled loops."""

import torch

from repro.runs.devices import few_threads
from repro.system import threads


def test_a_prediction_takes_the_chosen_threads_and_restores_those_of_the_caller(monkeypatch):
    before = torch.get_num_threads()
    monkeypatch.setattr(threads, "_threads", before + 2)
    with few_threads():
        assert torch.get_num_threads() == before + 2
    assert torch.get_num_threads() == before
