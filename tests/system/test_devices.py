import subprocess
import sys

import pytest
import torch

from repro.networks.create import create_network
from repro.networks.model import paper_model
from repro.system import devices
from repro.system.devices import compiles, resolve_device, resolve_precision


def test_a_failed_compilation_is_reported_and_skipped(monkeypatch, caplog):
    def fail(self, *_, **__):
        self.forward = None  # the compiler's failure shows at the first call

    monkeypatch.setattr(torch.nn.Module, "compile", fail)
    assert not compiles(create_network(paper_model("fpn")), torch.zeros(2, 1, 64, 64))
    assert "torch.compile failed (TypeError: 'NoneType' object is not callable)" in caplog.text
    monkeypatch.setattr(torch.nn.Module, "compile", lambda self: None)
    assert compiles(create_network(paper_model("fpn")), torch.zeros(2, 1, 64, 64))


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
from repro.system.devices import forget_peak_memory, peak_memory_gb

forget_peak_memory()
before = peak_memory_gb()
block = torch.ones(100_000_000, dtype=torch.uint8)
with_block = peak_memory_gb()
del block
forget_peak_memory()
print(before, with_block, peak_memory_gb())
"""


@pytest.mark.slow
def test_peak_memory_is_measured_since_its_reset():
    """Measure in a new process, because one with free resident memory shows no new peak."""
    done = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True, timeout=120)
    before, with_block, after = map(float, done.stdout.split())
    assert with_block > before + 0.09
    assert after < with_block - 0.05
