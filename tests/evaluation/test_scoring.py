import numpy as np
import pandas as pd
import pytest
from conftest import prepared

from repro.evaluation.scoring import evaluate, measure, read_predictions
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.metrics.counts import counts_of, pooled_scores
from repro.metrics.headings import METRICS
from repro.recordings.datasets import load_pairs
from repro.recordings.reader import open_recordings
from repro.runs.provenance import Status


def test_metrics_follow_from_the_stored_predictions(evaluated, recorded):
    kept = read_predictions(evaluated)[:, None]
    truth = load_pairs(open_recordings(recorded), "test", Grid(32, 50.0), Projection()).maps.numpy()
    again = pooled_scores(counts_of(kept, truth).sum(0))
    row = pd.read_csv(evaluated.metrics).iloc[0]
    assert kept.shape == truth.shape == (8, 1, 32, 32)
    for name in METRICS[1:]:
        assert row[name] == pytest.approx(again[name].item(), abs=2e-3), name


def test_per_image_metrics_agree_with_the_pooled_ones(evaluated):
    rows, pooled = pd.read_csv(evaluated.path / "per_image.csv"), pd.read_csv(evaluated.metrics)
    assert len(rows) == 8
    assert len(pooled) == 1
    assert pooled["ssim"].item() == pytest.approx(rows["ssim"].mean(), abs=1e-5)
    assert pooled["accuracy"].item() == pytest.approx(rows["accuracy"].mean(), abs=1e-5)
    assert set(METRICS) | {"obstacle_iou", "obstacle_dice"} <= set(pooled.columns) <= set(rows.columns)


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (np.full((1, 1, 32, 32), 0.5), r"\(4, 1, 32, 32\) as the maps, got \(1, 1, 32, 32\)"),
        (np.full((4, 32, 32), 0.5), r"got \(4, 32, 32\)"),
        ([0.5], "expected probabilities of free, .*, got list"),
        (np.full((4, 1, 32, 32), -0.5), "values from -0.5 to -0.5"),
        (np.full((4, 1, 32, 32), 3.0), "logits need a sigmoid"),
        (np.full((4, 1, 32, 32), np.nan), "logits need a sigmoid"),
    ],
)
def test_what_is_no_prediction_of_the_maps_is_not_measured(free, message):
    with pytest.raises(ValueError, match=message):
        measure(free, np.ones((4, 1, 32, 32), np.uint8))


def test_provenance_names_the_data(evaluated, recorded):
    origin = evaluated.provenance()
    assert origin.status is Status.evaluated
    assert origin.fact("recordings") == open_recordings(recorded).hash()
    assert origin.fact("test_pairs") == 8


def test_an_untrained_run_is_refused(recorded, tmp_path):
    with pytest.raises(ValueError, match="not fully trained"):
        evaluate(prepared(tmp_path), recorded)


def test_all_free_scores_the_free_share(recorded, tmp_path):
    row = evaluate(prepared(tmp_path, model="all_free"), recorded)
    free = load_pairs(open_recordings(recorded), "test", Grid(32, 50.0), Projection()).maps.numpy().mean().item()
    assert row["accuracy"] == row["precision"] == pytest.approx(free)
    assert row["recall"] == pytest.approx(1)
    assert row["specificity"] == pytest.approx(0, abs=1e-6)
