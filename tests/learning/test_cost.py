import pytest

from repro.config import NETWORKS, PairCounts, Scale
from repro.learning import cost
from repro.learning.cost import plan_study, readable

SCALE = Scale(
    name="paper",
    takes="a day",
    size_px=32,
    pairs=PairCounts(10000, 128, 500),
    learning_rate=1e-4,
    batch_size=2,
    max_epochs=100,
    flip_augmentation=False,
    ema_decay=None,
)


@pytest.mark.slow
def test_plan_lists_recordings_trainings_evaluations_and_the_total():
    trainings = {"unet": 6, "fpn": 0, "upernet": 1, "segformer": 2}
    text = "\n".join(plan_study(SCALE, "32-true", 1000, trainings, 9))
    assert "1000 recordings: 12 s" in text
    assert all(part in text for part in ("6 x unet: ", "fpn: done", "1 x upernet: ", "2 x segformer: "))
    assert "evaluation and analysis of 9 runs: 45 s" in text
    assert "in total, at 20 epochs per training" in text


def test_a_finished_study_is_not_measured(monkeypatch):
    monkeypatch.setattr(cost, "seconds_per_image", None)
    assert [line.strip() for line in plan_study(SCALE, "32-true", 0, dict.fromkeys(NETWORKS, 0), 0)] == [
        "recordings: done",
        *(f"{name}: done" for name in NETWORKS),
    ]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0 s"), (89, "89 s"), (90, "2 min"), (7199, "120 min"), (7200, "2 h")]
)
def test_durations_are_readable(seconds, text):
    assert readable(seconds) == text
