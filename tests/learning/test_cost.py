import torch

from repro.config import NETWORKS, PairCounts, Scale
from repro.learning.cost import cost_warning, plan_study

SCALE = Scale(
    name="paper",
    size_px=64,
    pairs=PairCounts(10000, 128, 500),
    learning_rate=1e-4,
    batch_size=2,
    max_epochs=100,
    flip_augmentation=False,
    ema_decay=None,
)


def test_plan_says_scale_reason_and_time():
    trainings = {"unet": 6, "fpn": 0, "upernet": 1, "segformer": 2}
    text = "\n".join(plan_study(SCALE, "32-true", 1000, trainings))
    assert "Scale paper" in text
    assert "64 px, 10000 training pairs" in text
    assert "at 20 epochs a training" in text
    assert "1000 recordings: 4 s" in text
    assert all(words in text for words in ("6 x unet: ", "fpn: done", "1 x upernet: ", "2 x segformer: "))


def test_nothing_is_measured_of_what_is_done(monkeypatch):
    monkeypatch.setattr(planning, "seconds_per_image", None)
    text = "\n".join(plan_study(SCALE, "32-true", 0, dict.fromkeys(NETWORKS, 0)))
    assert "recordings: done" in text
    assert "About 0 s in all" in text


def test_without_gpu_the_cost_and_the_way_out_are_named(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    text = cost_warning(["unet"] * 8, SCALE, "32-true")
    assert text is not None
    assert "no CUDA GPU" in text
    assert "these 8 trainings take" in text
    assert "scale=laptop" in text
