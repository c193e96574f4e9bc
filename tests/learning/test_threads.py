"""Threads of a prediction: one unless the user has chosen more."""

import pytest
import torch

from repro.runs import devices
from repro.runs.devices import few_threads


@pytest.fixture
def unchosen(monkeypatch):
    """Two threads by default, of which the user has chosen none."""
    before = torch.get_num_threads()
    monkeypatch.setattr(devices, "_IN_ENVIRONMENT", False)
    monkeypatch.setattr(devices, "_AT_IMPORT", 2)
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def test_a_prediction_takes_one_thread_and_restores_those_of_the_caller(unchosen):
    with few_threads():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == 2


def test_threads_that_the_user_has_chosen_are_taken(unchosen, monkeypatch):
    torch.set_num_threads(3)
    with few_threads():
        assert torch.get_num_threads() == 3
    torch.set_num_threads(2)
    monkeypatch.setattr(devices, "_IN_ENVIRONMENT", True)  # OMP_NUM_THREADS=2
    with few_threads():
        assert torch.get_num_threads() == 2
