"""Where and when a prediction is right: by how long ago each pixel was seen, and each obstacle hit."""

import itertools
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from repro.evaluation.recency import (
    BIN,
    BINS,
    RECENCY,
    age_bin,
    newest_hits_of_obstacles,
    obstacle_masks,
    pixel_groups,
)
from repro.maps.datasets import true_maps
from repro.maps.grid import Grid
from repro.metrics.bootstrap import bounds
from repro.metrics.calibration import brier, entropy
from repro.metrics.counts import average_precision, pooled_scores
from repro.recordings.reader import read_manifest, read_shards

HITS = {**dict(list(RECENCY.items())[:4]), "never": range(BINS, BINS + 1)}


@dataclass(frozen=True)
class TestSet:
    """The test recordings of an experiment: what was true, when it was seen, which obstacle was hit when.

    Args:
        truth: true maps, 1 is free, (M, H, W).
        groups: see `recency.pixel_groups`, (M, H, W).
        masks: each obstacle by itself, (K, H, W).
        recording: the recording of each obstacle, of either twin, (2, K).
        newest: the newest step at which it was hit there, 0 for never, (2, K).
        steps: steps of a recording, T.
    """

    truth: np.ndarray
    groups: np.ndarray
    masks: np.ndarray
    recording: np.ndarray
    newest: np.ndarray
    steps: int


def load_test_set(recordings: Path, grid: Grid) -> TestSet:
    """Reads the test recordings of an experiment and labels them.

    Raises:
        ValueError: a shard cannot be trusted, see `store.read_shards`.
    """
    range_max_m = read_manifest(recordings).spec["robot"]["sensors"][0]["range_max"]
    parts: dict[str, list[np.ndarray]] = defaultdict(list)
    first = 0
    for shard in read_shards(recordings, "test"):
        parts["truth"].append(true_maps(shard, grid).numpy())
        parts["groups"].append(pixel_groups(shard.scans, grid, range_max_m))
        parts["masks"].append(obstacle_masks(shard, grid))
        parts["recording"].append(first + 2 * shard.world + np.array([[0], [1]]))
        parts["newest"].append(newest_hits_of_obstacles(shard))
        first, steps = first + len(shard.scans), shard.scans.ranges.shape[1]
    of_obstacles = ("recording", "newest")
    whole = {name: np.concatenate(found, axis=int(name in of_obstacles)) for name, found in parts.items()}
    return TestSet(**whole, steps=steps)


def by_recency(counts: np.ndarray, weights: np.ndarray) -> pd.DataFrame:
    """Measures each recency, and all together, with intervals over worlds.

    Args:
        counts: of each world by group, truth and level, (W, G, 2, 256).
        weights: how often each world is taken in each draw, the first row every one once, (draws + 1, W).

    Returns:
        recency, metric, value, low, high, a row each; what has no pixel, or no obstacle, has no row.
    """
    recency = {"all": range(counts.shape[1]), **RECENCY}
    summed = np.stack([counts[:, list(groups)].sum(1) for groups in recency.values()], axis=1)
    drawn = np.tensordot(weights.astype(np.float64), summed, axes=1)  # (draws + 1, recency, 2, 256)
    measured = {"pixel_share": drawn.sum((2, 3)) / drawn[:, :1].sum((2, 3)), **measures(drawn)}
    rows = []
    for name, values in measured.items():
        low, high = bounds(values)
        rows += [
            {"recency": recency, "metric": name, "value": values[0, i], "low": low[i], "high": high[i]}
            for i, recency in enumerate(recency)
            if np.isfinite([values[0, i], low[i], high[i]]).all()
        ]
    return pd.DataFrame(rows)


def by_age(counts: np.ndarray) -> pd.DataFrame:
    """Measures each bin of ages, from (G, 2, 256): age (its first, in steps), metric, value."""
    measured = pd.DataFrame(measures(counts[:BINS]))
    return measured.assign(age=BIN * np.arange(BINS) + 1).melt("age", var_name="metric").dropna()


def measures(counts: np.ndarray) -> dict[str, np.ndarray]:
    """Computes what is asked of a part of the map from (..., 2, 256), each (...), nan where it has no meaning.

    Obstacle recall is the paper's specificity, free recall its recall; `pr_auc` is of obstacles, `entropy` in nats.
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
        "pr_auc": average_precision(counts),
        "brier": brier(counts),
        "entropy": entropy(counts),
    }


def by_last_hit(predictions: list[np.ndarray], test: TestSet, weights: np.ndarray) -> pd.DataFrame:
    """Says how much of each obstacle is predicted, and how many at least half, by when each was last hit.

    Args:
        predictions: predictions of each seed, uint8, (M, H, W).
        test: the test recordings.
        weights: see `by_recency`.

    Returns:
        last_hit, metric (`obstacles` how many, `recall` their mean share found, `detected` the share of those found at
        least half), value, low, high.
    """
    area = test.masks.sum((1, 2))
    group = np.where(test.newest > 0, age_bin(test.steps - test.newest + 1), BINS)
    found = np.zeros_like(test.newest, dtype=float)
    for free, twin in itertools.product(predictions, (0, 1)):
        for number in np.flatnonzero(area):
            predicted = free[test.recording[twin, number]][test.masks[number]] < 128
            found[twin, number] += predicted.mean() / len(predictions)
    rows = []
    for name, bins in HITS.items():
        chosen = np.isin(group, list(bins)) & (area > 0)
        rows.append({"last_hit": name, "metric": "obstacles", "value": float(chosen.sum())})
        if not chosen.any():
            continue
        times = weights[:, test.recording[chosen] // 2].astype(float)
        for metric, value in {"recall": found[chosen], "detected": (found[chosen] >= 0.5).astype(float)}.items():
            drawn = times @ value / np.maximum(times.sum(1), 1)
            low, high = bounds(drawn)
            rows.append({"last_hit": name, "metric": metric, "value": drawn[0], "low": low, "high": high})
    return pd.DataFrame(rows)
