"""Threads of a prediction: one unless the user has chosen more, and bearable beside other work on the same cores."""

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from conftest import ROOT

from repro.system import devices
from repro.system.devices import few_threads

BUSY = 2  # processes that compute without end
MOST = 3  # multiples of its share that an update may take


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


def spin() -> None:
    while True:
        pass


def times(**variables: str) -> tuple[float, ...]:
    """Run `update_times.py` in a process in which nobody has chosen the threads."""
    environment = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")} | variables
    run = [sys.executable, Path(__file__).with_name("update_times.py"), ROOT / "examples" / "rooms.npz"]
    done = subprocess.run(run, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return tuple(map(float, done.stdout.split()))


@pytest.mark.slow
def test_an_update_beside_busy_processes_costs_at_most_three_times_its_share():
    """With the two threads of torch, it took up to 40 times its share."""
    busy = [multiprocessing.Process(target=spin, daemon=True) for _ in range(BUSY)]
    for process in busy:
        process.start()
    try:
        _, work, _ = times(OMP_NUM_THREADS="1")
        wall, _, stretched = times()
    finally:
        for process in busy:
            process.kill()
            process.join()
    assert wall < MOST * work * stretched, f"{wall:.2f} s for {work:.2f} s of work, stretched {stretched:.1f} times"
