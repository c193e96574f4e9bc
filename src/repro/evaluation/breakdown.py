"""Prediction quality by recency: time since each pixel was last seen and each obstacle last hit."""

import itertools
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from repro.evaluation.recency import (
    OCCLUDED,
    RECENCY,
    age_group,
    newest_hits_of_obstacles,
    obstacle_masks,
    pixel_groups,
)
from repro.maps.grid import Grid
from repro.metrics.bootstrap import bounds
from repro.metrics.calibration import brier, entropy, log_loss
from repro.metrics.counts import LEVELS, best_iou, pooled_scores
from repro.metrics.scores import THRESHOLD
from repro.recordings.reader import Recordings
from repro.recordings.recorded import true_maps

HITS = (*RECENCY[:OCCLUDED], "never")  # groups of obstacles


@dataclass(frozen=True)
class TestSet:
    """The test recordings of an experiment: true maps, recency of the pixels, newest hits of the obstacles.

    Args:
        truth: true maps, 1 is free, (M, H, W).
        groups: recency group of each pixel, see `recency.pixel_groups`, (M, H, W).
        masks: pixels of each single obstacle, (K, H, W).
        recording: index of the recording of each obstacle, for both twins, (2, K).
        newest: newest step at which the obstacle was hit in that recording, 0 for never, (2, K).
        steps: number of steps of a recording, T.
    """

    truth: np.ndarray
    groups: np.ndarray
    masks: np.ndarray
    recording: np.ndarray
    newest: np.ndarray
    steps: int


def load_test_set(recordings: Recordings, grid: Grid) -> TestSet:
    """Read the test recordings of an experiment and label their pixels and obstacles.

    Raises:
        InputError: a shard is damaged, see `Recordings.shards`.
    """
    lidar = recordings.spec.lidar
    parts: dict[str, list[np.ndarray]] = defaultdict(list)
    first = 0
    for shard in recordings.shards("test"):
        parts["truth"].append(true_maps(shard, grid))
        parts["groups"].append(pixel_groups(shard.scans, grid, lidar.range_max))
        parts["masks"].append(obstacle_masks(shard, grid))
        parts["recording"].append(first + 2 * shard.world + np.array([[0], [1]]))
        parts["newest"].append(newest_hits_of_obstacles(shard, lidar.std or 0.0))
        first, steps = first + len(shard.scans), shard.scans.ranges.shape[1]
    of_obstacles = ("recording", "newest")
    arrays = {name: np.concatenate(part, axis=int(name in of_obstacles)) for name, part in parts.items()}
    return TestSet(**arrays, steps=steps)


def by_recency(counts: np.ndarray, weights: np.ndarray) -> pd.DataFrame:
    """Measure the predictions by recency, and over all pixels, with intervals over worlds.

    Args:
        counts: counts of each world by group, truth and quantized probability, (W, G, 2, 256).
        weights: number of times each world is taken in each draw, the first row every world once, (draws + 1, W).

    Returns:
        rows of recency, metric, value, low, high; undefined values (no pixel or no obstacle) have no row.
    """
    summed = np.concatenate([counts.sum(1, keepdims=True), counts], axis=1)
    drawn = np.tensordot(weights.astype(np.float64), summed, axes=1)  # (draws + 1, recency, 2, 256)
    measured = {"pixel_share": drawn.sum((2, 3)) / drawn[:, :1].sum((2, 3)), **measures(drawn)}
    rows = []
    for name, values in measured.items():
        low, high = bounds(values)
        rows += [
            {"recency": recency, "metric": name, "value": values[0, i], "low": low[i], "high": high[i]}
            for i, recency in enumerate(("all", *RECENCY))
            if np.isfinite([values[0, i], low[i], high[i]]).all()
        ]
    return pd.DataFrame(rows)


def measures(counts: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the measures of a part of the map from counts (..., 2, 256), each (...), nan where undefined.

    Obstacle recall is the paper's specificity, free recall the paper's recall; `best_iou` is the obstacle IoU at the
    threshold that maximizes it; `log_loss` and `entropy` are in nats.
    """
    scored = pooled_scores(counts)
    obstacles, free = counts[..., 0, :].sum(-1), counts[..., 1, :].sum(-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = obstacles / (obstacles + free)
    return {
        "obstacle_share": share,
        "obstacle_recall": np.where(obstacles > 0, scored["specificity"], np.nan),
        "free_recall": np.where(free > 0, scored["recall"], np.nan),
        "obstacle_iou": np.where(obstacles > 0, scored["obstacle_iou"], np.nan),
        "best_iou": np.where(obstacles > 0, best_iou(counts), np.nan),
        "brier": brier(counts),
        "log_loss": log_loss(counts),
        "entropy": entropy(counts),
    }


def by_last_hit(predictions: Sequence[np.ndarray], test: TestSet, weights: np.ndarray) -> pd.DataFrame:
    """Measure the predicted share of each obstacle and the share of detected obstacles, by time since the last hit.

    Args:
        predictions: quantized predictions of each seed, uint8, (M, H, W).
        weights: see `by_recency`.

    Returns:
        rows of last_hit, metric, value, low, high. The metrics are `obstacles` (their number), `recall` (mean predicted
        share of an obstacle) and `detected` (share of the obstacles that are predicted by at least half); the last two
        have no row where the obstacles of a group are too rare for an interval.
    """
    area = test.masks.sum((1, 2))
    group = np.where(test.newest > 0, age_group(test.steps - test.newest + 1), HITS.index("never"))
    recall = np.zeros_like(test.newest, dtype=float)
    for free, twin in itertools.product(predictions, (0, 1)):
        for number in np.flatnonzero(area):
            predicted = free[test.recording[twin, number]][test.masks[number]] < THRESHOLD * LEVELS
            recall[twin, number] += predicted.mean() / len(predictions)
    rows = []
    for place, name in enumerate(HITS):
        chosen = (group == place) & (area > 0)
        rows.append({"last_hit": name, "metric": "obstacles", "value": float(chosen.sum())})
        if not chosen.any():
            continue
        times = weights[:, test.recording[chosen] // 2].astype(float)
        for metric, value in {"recall": recall[chosen], "detected": (recall[chosen] >= 0.5).astype(float)}.items():
            with np.errstate(invalid="ignore"):
                drawn = times @ value / times.sum(1)  # nan in a draw without an obstacle of the group
            low, high = bounds(drawn)
            if np.isfinite([low, high]).all():
                rows.append({"last_hit": name, "metric": metric, "value": drawn[0], "low": low, "high": high})
    return pd.DataFrame(rows)
