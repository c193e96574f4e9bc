"""Measures of maps from counts of pixels by truth and level, with intervals from logs drawn with replacement."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.isotonic import IsotonicRegression

from repro.metrics.bootstrap import DRAWS, bounds, draw_weights
from repro.metrics.calibration import BINS, brier, log_loss
from repro.metrics.counts import LEVELS, confusion_of
from repro.prediction.agreement import Observed

MEASURES = ("auroc", "brier", "log_loss", "hits_share", "free_share", "calibration_error")
COMPARED = 3  # the first measures, of which the table has differences


@dataclass(frozen=True)
class Measured:
    """A map of one log.

    Args:
        windows: number of windows.
        counts: pixels by block of the log, kind, truth (hits first) and level, (blocks, G, 2, 256).
        probability: of free for each level, (256,).
    """

    windows: int
    counts: np.ndarray
    probability: np.ndarray


def around(pixels: np.ndarray, size_px: int) -> np.ndarray:
    """Return the flat indices of pixels and of those beside them, (P,) to (P, 9), their own in the middle."""
    row, column = np.divmod(pixels[:, None], size_px)
    up, right = np.divmod(np.arange(9), 3)
    return (row + up - 1).clip(0, size_px - 1) * size_px + (column + right - 1).clip(0, size_px - 1)


def count(levels: np.ndarray, groups: list[Observed], pixels: np.ndarray) -> np.ndarray:
    """Count pixels by kind, truth, hits first, and level, (G, 2, 256).

    Args:
        levels: levels of the pixels, (P,).
        groups: what held-out beams show, by kind, G.
        pixels: flat indices of the pixels, (P,).
    """
    masks = [mask.ravel()[pixels] for group in groups for mask in (group.hits, group.passed)]
    counts = [np.bincount(levels[mask], minlength=LEVELS) for mask in masks]
    return np.stack(counts).reshape(len(groups), 2, LEVELS)


def counts_of(levels: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Count pixels by truth, hits first, and level, from (P,) and (P,), (2, 256)."""
    return np.stack([np.bincount(levels[free == truth], minlength=LEVELS) for truth in (0, 1)])


def auroc(counts: np.ndarray) -> np.ndarray:
    """Compute the area under the ROC curve of free, (...), from (..., 2, 256); NaN without hits or passed pixels."""
    hits, passed = counts[..., 0, :], counts[..., 1, :]
    below = np.cumsum(hits, -1) - hits / 2
    with np.errstate(invalid="ignore"):
        return (passed * below).sum(-1) / (hits.sum(-1) * passed.sum(-1))


def measures(counts: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Compute `MEASURES` from counts, (..., 2, 256), and the probability of each level, (..., M)."""
    free, missed, found, wrong = np.moveaxis(confusion_of(counts), -1, 0)
    with np.errstate(invalid="ignore"):
        scores = brier(counts, probability), log_loss(counts, probability)
        shares = found / (found + missed), free / (free + wrong)
        return np.stack([auroc(counts), *scores, *shares, calibration_error(counts, probability)], axis=-1)


def calibration_error(counts: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Compute the expected calibration error in 15 bins of the probability of free, (...), from (..., 2, 256)."""
    bins = np.minimum((probability * BINS).astype(int), BINS - 1)
    in_bin = bins[:, None] == np.arange(BINS)
    gap = counts[..., 1, :] - counts.sum(-2) * probability
    return np.abs(gap @ in_bin).sum(-1) / counts.sum((-2, -1))


def calibrated(counts: np.ndarray) -> np.ndarray:
    """Return the probability of free for each level, (256,), by isotonic regression on counts, (2, 256)."""
    totals = counts.sum(0)
    share = counts[1] / np.maximum(totals, 1)
    return IsotonicRegression(out_of_bounds="clip").fit(np.arange(LEVELS), share, totals).predict(np.arange(LEVELS))


def drawn(measured: Measured, seed: int) -> np.ndarray:
    """Compute the measures of a log with its blocks drawn with replacement, (draws + 1, G, M), the first undrawn."""
    blocks = len(measured.counts)
    weights = draw_weights(blocks)
    weights[1:] = np.random.default_rng(seed).permutation(weights[1:])  # each log has draws of its own
    if blocks == 1:
        weights = weights[:1]
    values = measures(np.einsum("db,bgtl->dgtl", weights, measured.counts), measured.probability)
    return np.broadcast_to(values, (DRAWS + 1, *values.shape[1:]))


def mean_over_logs(values: np.ndarray) -> np.ndarray:
    """Average defined values over logs drawn with replacement, (draws + 1, logs, G, M) to (draws + 1, G, M)."""
    weights = draw_weights(values.shape[1])[:, :, None, None] * np.isfinite(values)
    with np.errstate(invalid="ignore"):
        return (weights * np.nan_to_num(values)).sum(1) / weights.sum(1)


def rows_of(
    maps: dict[str, dict[str, Measured]], groups: tuple[str, ...], reference: str, sets: dict[str, list[str]]
) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table: for each map and kind of pixels the mean over each set of logs, then each log.

    `less_<measure>` is that of the reference less that of the map, a positive one better for the AUROC and a negative
    one for the others. Means have intervals of 95 % from logs drawn with replacement, and within them blocks.

    Args:
        maps: what is measured, by the name of the map and that of the log.
        groups: names of the kinds of pixels, G.
        reference: the map with which the others are compared.
        sets: names of logs, by what is said of them.
    """
    values = {
        name: {log: drawn(measured, seed) for seed, (log, measured) in enumerate(logs.items())}
        for name, logs in maps.items()
    }
    every = {log: [log] for log in next(iter(maps.values()))}
    for title, chosen in {**sets, **every}.items():
        for name, logs in maps.items():
            own = np.stack([values[name][log] for log in chosen], axis=1)
            means = mean_over_logs(own)
            less = mean_over_logs(np.stack([values[reference][log] for log in chosen], axis=1) - own)
            totals = sum(logs[log].counts.sum((0, 3)) for log in chosen)  # (G, 2)
            for number, group in enumerate(groups):
                row: dict[str, Any] = {"logs": title, "count": len(chosen), "map": name, "pixels": group}
                row["windows"] = sum(logs[log].windows for log in chosen)
                row |= {"hits": int(totals[number, 0]), "passed": int(totals[number, 1])}
                if len(chosen) > 1:
                    row |= _intervals(MEASURES, means[:, number])
                    row |= _intervals([f"less_{each}" for each in MEASURES[:COMPARED]], less[:, number])
                else:
                    row |= dict(zip(MEASURES, means[0, number], strict=True))
                yield row


def _intervals(names: Any, means: np.ndarray) -> dict[str, float]:
    """Return the value of each measure and its interval, from (draws + 1, measures)."""
    low, high = bounds(means)
    row: dict[str, float] = {}
    for number, name in enumerate(names):
        row |= {name: means[0, number], f"{name}_low": low[number], f"{name}_high": high[number]}
    return row
