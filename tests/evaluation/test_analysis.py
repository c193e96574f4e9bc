import numpy as np
import pytest
from conftest import prepared

from repro.evaluation.analysis import gather
from repro.evaluation.breakdown import by_last_hit, by_recency, load_test_set
from repro.evaluation.evaluate import evaluate
from repro.evaluation.recency import GROUPS, NEVER_IN_VIEW, RECENCY, age_bin, newest_hits_of_obstacles, pixel_groups
from repro.learning.training import train
from repro.maps.grid import Grid
from repro.metrics.bootstrap import draw_weights
from repro.metrics.counts import count_quantized
from repro.recordings.reader import read_shards
from repro.runs.directories import Outputs

GRID = Grid(32, 50.0)


@pytest.fixture(scope="module")
def test_set(recorded):
    return load_test_set(recorded, GRID)


@pytest.fixture(scope="module")
def outputs(recorded):
    """Two seeds of a network and a baseline, evaluated beside their recordings."""
    found = Outputs(recorded.parents[1])
    for seed in (0, 1):
        run = prepared(found.run("3", "unet", "decay", seed).path, seed=seed, max_epochs=1)
        train(run, recorded, accelerator="cpu")
        evaluate(run, recorded, accelerator="cpu")
    evaluate(prepared(found.run("3", "last_seen", "decay", 0).path, model="last_seen"), recorded)
    return found


def test_ages_fall_into_bins():
    assert age_bin(np.array([1, 5, 6, 10, 11, 95, 96, 100, 250])).tolist() == [0, 0, 1, 1, 2, 18, 19, 19, 19]
    names = [group for groups in RECENCY.values() for group in groups]
    assert names == list(range(GROUPS))


def test_what_lies_beyond_the_lidar_is_out_of_range(recorded):
    shard = next(read_shards(recorded, "test"))
    groups = pixel_groups(shard.scans, GRID, 30.0)
    distance = (GRID.centers() - 25).norm(dim=-1).view(32, 32).numpy()
    assert (groups[:, distance > 30] == NEVER_IN_VIEW).all()
    assert (groups[:, distance < 29] != NEVER_IN_VIEW).all()  # the robot turns round once, in the middle


def test_obstacles_hit_are_those_the_recorder_saw_hit(recorded):
    shard = next(read_shards(recorded, "test"))
    newest = newest_hits_of_obstacles(shard)
    rank = np.arange(len(shard.world)) - np.searchsorted(shard.world, shard.world)
    for twin in (0, 1):
        assert np.array_equal(newest[twin] > 0, shard.seen[2 * shard.world + twin, rank])
    assert newest.max() <= 100


def test_a_perfect_prediction_is_perfect_in_every_stratum(test_set):
    perfect = 255 * test_set.truth
    counts = count_quantized(perfect, test_set.truth, test_set.groups, GROUPS)
    table = by_recency(counts.reshape(4, 2, *counts.shape[1:]).sum(1), draw_weights(4, draws=50))
    values = table.pivot(index="recency", columns="metric", values="value")
    for metric in ("obstacle_recall", "free_recall", "obstacle_iou", "pr_auc"):
        assert np.allclose(values[metric].dropna(), 1, atol=1e-6), metric
    assert np.allclose(values["brier"].dropna(), 0)
    assert values.drop("all")["pixel_share"].sum() == pytest.approx(1)
    hits = by_last_hit([perfect], test_set, draw_weights(4, draws=50))
    found = hits.pivot(index="last_hit", columns="metric", values="value")
    assert np.allclose(found["recall"].dropna(), 1)
    area = test_set.masks.sum((1, 2)) > 0
    assert found["obstacles"].sum() == 2 * area.sum()


def test_nothing_found_is_no_recall(test_set):
    free = np.full_like(test_set.truth, 255)
    hits = by_last_hit([free], test_set, draw_weights(4, draws=50))
    assert (hits[hits["metric"] != "obstacles"]["value"] == 0).all()


def test_evidence_is_gathered_from_what_lies_there(outputs):
    frames = gather(outputs)
    names = {"intervals", "differences", "recency", "ages", "obstacles", "calibration", "reliability", "cost"}
    assert set(frames) == names
    for name, frame in frames.items():
        keys = ["experiment", "model", "encoding", "decay"]
        assert set(frame.columns) >= ({"one", "other"} if name == "differences" else set(keys)), name
        assert not frame.empty, name
    rows = frames["intervals"].set_index(["model", "metric"])
    assert (rows["low"] <= rows["value"] + 1e-9).all()
    assert (rows["value"] <= rows["high"] + 1e-9).all()
    assert rows.loc[("unet", "accuracy"), "seeds"] == 2
    whats = frames["calibration"]["what"].unique().tolist()
    assert whats == ["as it is", "temperature_scaled", "mean of 2 seeds"]
    assert (frames["cost"]["channels"] == 1).all()
    assert frames["differences"]["what"].unique().tolist() == ["networks"]


def test_evidence_says_what_the_tables_say(outputs):
    row = gather(outputs)["intervals"].query("model == 'last_seen'").set_index("metric")["value"]
    kept = evaluate(outputs.run("3", "last_seen", "decay", 0), outputs.recordings("3"))
    for metric in ("accuracy", "specificity", "ssim", "obstacle_iou"):
        assert row[metric] == pytest.approx(kept[metric], abs=1e-5), metric
