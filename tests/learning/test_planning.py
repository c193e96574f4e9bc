import torch

from repro.config import PairCounts, Scale
from repro.learning.planning import cost_warning, plan_study

SCALE = Scale(
    name="paper",
    size_px=64,
    pairs=PairCounts(10000, 128, 500),
    learning_rate=1e-4,
    batch_size=2,
    max_epochs=100,
    mirror=False,
    weight_average=None,
)


def test_plan_says_scale_reason_and_time():
    text = plan_study(SCALE, "32-true")
    assert "Scale paper" in text
    assert "64 px, 10000 training pairs" in text
    assert "at 20 epochs a training" in text
    assert all(name in text for name in ("unet", "fpn", "upernet", "segformer"))


def test_without_gpu_the_cost_and_the_way_out_are_named(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    text = cost_warning("unet", SCALE, "32-true")
    assert text is not None
    assert "No CUDA GPU" in text
    assert "scale=laptop" in text
