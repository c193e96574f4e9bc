import subprocess

import pytest
import torch

from repro.runs import devices
from repro.runs.devices import resolve_device, resolve_precision


@pytest.mark.parametrize(("native", "auto"), [(True, "bf16-mixed"), (False, "32-true")])
def test_automatic_precision_follows_the_device(native, auto, monkeypatch):
    monkeypatch.setattr(devices, "has_bfloat16", lambda device: native)
    assert resolve_precision("auto", "cpu") == auto
    assert resolve_precision("bf16-mixed", "cpu") == "bf16-mixed"
    assert resolve_precision("32-true", "cpu") == "32-true"


def test_a_missing_device_is_refused(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert resolve_device("auto") == resolve_device("cpu") == "cpu"
    with pytest.raises(ValueError, match=r"accelerator=gpu, but no CUDA GPU is visible"):
        resolve_device("gpu")
    with pytest.raises(ValueError, match="must be auto, cpu or gpu, got 'tpu'"):
        resolve_device("tpu")


PEAK = """
import torch
from repro.runs.devices import forget_peak_memory, peak_memory_gb

forget_peak_memory()
before = peak_memory_gb()
block = torch.ones(100_000_000, dtype=torch.uint8)
with_block = peak_memory_gb()
del block
forget_peak_memory()
print(before, with_block, peak_memory_gb())
"""


@pytest.mark.slow
def test_peak_memory_is_measured_since_its_reset(python):
    """Measure in a new process, because one with free resident memory shows no new peak."""
    done = subprocess.run([python, "-c", PEAK], capture_output=True, text=True, check=True, timeout=120)
    before, with_block, after = map(float, done.stdout.split())
    assert with_block > before + 0.09
    assert after < with_block - 0.05
