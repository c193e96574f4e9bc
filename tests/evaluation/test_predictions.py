import numpy as np
import pandas as pd
import pytest
import segmentation_models_pytorch as smp
import torch
from conftest import run_config

from repro.evaluation.metrics import METRICS, confusion, scores
from repro.evaluation.predictions import (
    best_radius,
    evaluate,
    evaluate_baseline,
    last_seen,
    predict,
    read_predictions,
    validate,
)
from repro.learning.training import train
from repro.maps.datasets import Pairs, load_pairs
from repro.maps.grid import Grid
from repro.runs import prepare_run, read_provenance
from repro.simulation.store import recordings_hash


@pytest.fixture(scope="module")
def evaluated(recorded, tmp_path_factory):
    run = tmp_path_factory.mktemp("evaluated")
    prepare_run(run, run_config(max_epochs=2))
    train(run, recorded, accelerator="cpu")
    evaluate(run, recorded, accelerator="cpu")
    return run


def test_metrics_follow_from_the_kept_predictions(evaluated, recorded):
    kept = torch.as_tensor(read_predictions(evaluated))[:, None]
    truth = load_pairs(recorded, "test", Grid(32), decay=True, lightest=0.8).maps.float()
    again = scores(confusion(kept, truth).sum(0))
    row = pd.read_csv(evaluated / "metrics.csv").iloc[0]
    assert kept.shape == truth.shape == (8, 1, 32, 32)
    for name in METRICS[1:]:
        assert row[name] == pytest.approx(again[name].item(), abs=2e-3), name


def test_one_row_an_image_and_one_pooled(evaluated):
    rows, pooled = pd.read_csv(evaluated / "per_image.csv"), pd.read_csv(evaluated / "metrics.csv")
    assert len(rows) == 8
    assert len(pooled) == 1
    assert pooled["ssim"].item() == pytest.approx(rows["ssim"].mean(), abs=1e-5)
    assert pooled["accuracy"].item() == pytest.approx(rows["accuracy"].mean(), abs=1e-5)
    assert set(METRICS) | {"obstacle_iou", "obstacle_dice"} <= set(pooled.columns) <= set(rows.columns)


def test_provenance_names_the_data(evaluated, recorded):
    facts = read_provenance(evaluated)
    assert facts["status"] == "evaluated"
    assert facts["recordings"] == recordings_hash(recorded)
    assert facts["test_pairs"] == 8


def test_validation_is_measured_on_the_validation_set(evaluated, recorded):
    row = validate(evaluated, recorded, accelerator="cpu")
    val = load_pairs(recorded, "val", Grid(32), decay=True, lightest=0.8)
    probability = predict(smp.from_pretrained(evaluated / "model"), val)
    expected = scores(confusion(probability, val.maps.float()).sum(0))
    kept = pd.read_csv(evaluated / "validation.csv").iloc[0]
    for name in METRICS[1:]:
        assert row[name] == pytest.approx(expected[name].item(), abs=1e-6), name
        assert kept[name] == pytest.approx(row[name], abs=1e-6), name
    assert read_provenance(evaluated)["status"] == "evaluated"


@pytest.mark.parametrize("measure", [evaluate, validate])
def test_an_untrained_run_is_refused(measure, recorded, tmp_path):
    prepare_run(tmp_path, run_config())
    with pytest.raises(ValueError, match="not trained to its end"):
        measure(tmp_path, recorded)


def test_all_free_scores_the_free_share(recorded, tmp_path):
    prepare_run(tmp_path, {**run_config(), "model": {"name": "all_free"}})
    row = evaluate_baseline(tmp_path, recorded)
    free = load_pairs(recorded, "test", Grid(32), decay=True, lightest=0.8).maps.float().mean().item()
    assert row["accuracy"] == row["precision"] == pytest.approx(free)
    assert row["recall"] == pytest.approx(1)
    assert row["specificity"] == pytest.approx(0, abs=1e-6)


def test_last_seen_takes_its_radius_from_the_validation_set(recorded, tmp_path):
    prepare_run(tmp_path, {**run_config(), "model": {"name": "last_seen"}})
    row = evaluate_baseline(tmp_path, recorded)
    assert 0.1 < row["obstacle_iou"] < 1
    val = load_pairs(recorded, "val", Grid(32), decay=True, lightest=0.8)
    iou = [scores(confusion(last_seen(val, r), val.maps.float()).sum(0))["obstacle_iou"] for r in range(9)]
    assert read_provenance(tmp_path)["radius_px"] == int(np.argmax(iou)) == best_radius(val)


def test_last_seen_draws_discs_around_hits():
    images = torch.full((1, 1, 9, 9), 255, dtype=torch.uint8)
    images[0, 0, 4, 4] = 100
    pairs = Pairs(images, torch.ones(1, 1, 9, 9, dtype=torch.uint8))
    assert (last_seen(pairs, 0) == 0).sum() == 1
    disc = last_seen(pairs, 2)[0, 0] == 0
    assert disc.sum() == 13
    assert torch.equal(disc, disc.T)
