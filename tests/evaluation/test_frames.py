import dataclasses
import shutil

import numpy as np
import pytest
from conftest import ROOT, run_config

from repro.evaluation.breakdown import by_last_hit, by_recency, load_test_set
from repro.evaluation.frames import ANALYZED, averages, gather
from repro.evaluation.recency import NEVER_IN_VIEW, RECENCY, age_group, newest_hits_of_obstacles, pixel_groups
from repro.evaluation.scoring import evaluate, evaluate_baseline
from repro.learning.networks.create import create_network
from repro.learning.training import train
from repro.maps.grid import Grid
from repro.metrics.bootstrap import Measured, draw_weights
from repro.metrics.counts import count_quantized, pooled_scores
from repro.recordings.reader import open_recordings
from repro.runs.config import PROJECTION
from repro.runs.keys import RunKey
from repro.runs.model import NETWORKS, paper_model
from repro.runs.outputs import Outputs
from repro.simulation.recorder import record_experiment
from repro.worlds.spec import read_world, world_spec

GRID = Grid(32, 50.0)


@pytest.fixture(scope="module")
def test_set(recorded):
    return load_test_set(open_recordings(recorded), GRID)


@pytest.fixture(scope="module")
def outputs(recorded, evaluated, tmp_path_factory):
    """Two seeds of a network and a baseline, evaluated beside their recordings."""
    outputs = Outputs(tmp_path_factory.mktemp("analysis") / "laptop")
    shutil.copytree(recorded, outputs.recordings("3"))
    shutil.copytree(evaluated.path, outputs.run(evaluated.config().key).path)
    config = run_config(seed=1, max_epochs=1)
    run = outputs.run(config.key)
    run.prepare(config)
    train(run, recorded, accelerator="cpu")
    evaluate(run, recorded, accelerator="cpu")
    evaluate_baseline(outputs, run_config(), "last_seen")
    return outputs


def test_ages_fall_into_groups():
    assert age_group(np.array([1, 10, 11, 25, 26, 50, 51, 250])).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def test_pixels_beyond_the_range_of_the_lidar_are_never_in_view(recorded):
    shard = next(open_recordings(recorded).shards("test"))
    groups = pixel_groups(shard.scans, GRID, 30.0)
    distance = np.linalg.norm(GRID.centers() - 25, axis=-1).reshape(32, 32)
    assert (groups[:, distance > 30] == NEVER_IN_VIEW).all()
    assert (groups[:, distance < 29] != NEVER_IN_VIEW).all()  # the robot turns round once, in the middle


def test_hit_obstacles_are_those_of_the_recorder(recorded):
    shard = next(open_recordings(recorded).shards("test"))
    newest = newest_hits_of_obstacles(shard)
    rank = np.arange(len(shard.world)) - np.searchsorted(shard.world, shard.world)
    for twin in (0, 1):
        assert np.array_equal(newest[twin] > 0, shard.seen[2 * shard.world + twin, rank])
    assert newest.max() <= 100


@pytest.mark.parametrize("noise", [{}, {"noise": True, "std": 0.02}], ids=["exact", "noise"])
def test_hits_of_walls_and_concave_obstacles_are_those_of_the_recorder(noise, tmp_path):
    world = read_world(ROOT / "conf" / "world" / "office.yaml")
    lidar = {key: value for key, value in world["robot"]["sensors"][0].items() if key not in ("noise", "std")} | noise
    spec = world_spec(world | {"robot": world["robot"] | {"sensors": [lidar]}}, "people")
    record_experiment(tmp_path, spec, {"train": 2, "val": 2, "test": 6}, workers=1, verify_every=10**9)
    shard = next(open_recordings(tmp_path).shards("test"))
    newest = newest_hits_of_obstacles(shard, noise.get("std", 0.0))
    rank = np.arange(len(shard.world)) - np.searchsorted(shard.world, shard.world)
    for twin in (0, 1):
        seen = shard.seen[2 * shard.world + twin, rank]
        assert (newest[twin][seen] > 0).mean() > 0.98  # noise of more than three deviations is rare
        assert (newest[twin][~seen] > 0).mean() < 0.1  # where walls meet, a hit touches both
        assert 0.1 < seen.mean() < 0.9


def test_a_perfect_prediction_is_perfect_at_every_recency(test_set):
    perfect = 255 * test_set.truth
    counts = count_quantized(perfect, test_set.truth, test_set.groups, len(RECENCY))
    table = by_recency(counts.reshape(4, 2, *counts.shape[1:]).sum(1), draw_weights(4, draws=50))
    values = table.pivot(index="recency", columns="metric", values="value")
    for metric in ("obstacle_recall", "free_recall", "obstacle_iou", "best_iou"):
        assert np.allclose(values[metric].dropna(), 1, atol=1e-6), metric
    assert np.allclose(values["brier"].dropna(), 0)
    assert values.drop("all")["pixel_share"].sum() == pytest.approx(1)
    hits = by_last_hit([perfect], test_set, draw_weights(4, draws=50))
    by_hit = hits.pivot(index="last_hit", columns="metric", values="value")
    assert np.allclose(by_hit["recall"].dropna(), 1)
    area = test_set.masks.sum((1, 2)) > 0
    assert by_hit["obstacles"].sum() == 2 * area.sum()


@pytest.fixture(scope="module")
def frames(outputs):
    return gather(outputs)


@pytest.mark.slow
def test_frames_are_gathered_from_all_evaluated_runs(frames):
    assert set(frames) == set(ANALYZED)
    for name, frame in frames.items():
        assert set(frame.columns) >= {"experiment", "model", "encoding"}, name
        assert not frame.empty, name
    rows = frames["intervals"].set_index(["model", "metric"])
    assert (rows["low"] <= rows["value"] + 1e-9).all()
    assert (rows["value"] <= rows["high"] + 1e-9).all()
    assert rows.loc[("unet", "accuracy"), "seeds"] == 2
    assert (frames["cost"]["channels"] == 1).all()
    for row in frames["cost"].itertuples():
        network = create_network(paper_model(row.model))
        assert row.parameters == sum(weights.numel() for weights in network.parameters())


@pytest.mark.slow
def test_intervals_agree_with_the_metrics_of_the_run(outputs, frames):
    row = frames["intervals"].query("model == 'last_seen'").set_index("metric")["value"]
    kept = evaluate(outputs.run(RunKey("3", "last_seen")), outputs.recordings("3"))
    for metric in ("accuracy", "specificity", "ssim", "obstacle_iou"):
        assert row[metric] == pytest.approx(kept[metric], abs=1e-5), metric


def test_the_average_is_over_the_seeds_that_all_networks_have():
    """As in the tables, where a third seed of one network has no row `average` either."""
    weights, counts = draw_weights(5, draws=3), np.random.default_rng(0).integers(1, 99, (3, 5, 2, 256))
    counted, seeds = {}, {}
    for number, name in enumerate(NETWORKS):
        cell = ("3", name, PROJECTION)
        seeds[cell] = [0, 1, 2] if name == "unet" else [1, 0]
        counted[cell] = Measured(counts[: len(seeds[cell])] + number, {"ssim": np.full((len(seeds[cell]), 5), 0.5)})
    ((cell, table, common),) = list(averages(counted, seeds, weights))
    assert (cell, common) == (("3", "average", PROJECTION), 2)
    own = [pooled_scores(counts[:2].sum(1) + 5 * number)["accuracy"].mean() for number in range(len(NETWORKS))]
    assert table["accuracy"][0] == pytest.approx(np.mean(own))
    seeds["3", "fpn", PROJECTION] = [7, 8]
    assert not list(averages(counted, seeds, weights))


def test_the_interval_of_a_rare_group_is_left_out(test_set):
    """With 3 obstacles of two of 250 worlds, a tenth of the draws have none of them."""
    worlds = 250
    of, newest = np.arange(worlds), np.zeros((2, worlds), int)
    newest[0, :3] = 100
    of[2] = of[1]
    masks, free = np.ones((worlds, 4, 4), bool), np.zeros((2 * worlds, 4, 4), np.uint8)
    recording = np.stack([2 * of, 2 * of + 1])
    few = dataclasses.replace(test_set, masks=masks, recording=recording, newest=newest, steps=100)
    hits = by_last_hit([free], few, draw_weights(worlds, draws=200)).set_index(["last_hit", "metric"])
    assert hits.loc[("1-10", "obstacles"), "value"] == 3
    assert ("1-10", "detected") not in hits.index
    assert hits.loc[("never", "detected"), "value"] == 1
