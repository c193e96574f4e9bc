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
MEAN = "mean"


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


def neighbors(pixels: np.ndarray, size_px: int) -> np.ndarray:
    """Return the flat indices of the pixels within one pixel of others, (P,) to (P, 9), these in the middle."""
    row, column = np.divmod(pixels[:, None], size_px)
    up, right = np.divmod(np.arange(9), 3)
    return (row + up - 1).clip(0, size_px - 1) * size_px + (column + right - 1).clip(0, size_px - 1)


def count(levels: np.ndarray, groups: list[Observed], pixels: np.ndarray) -> np.ndarray:
    """Count pixels by kind, truth, hits first, and the lowest level within one pixel, (G, 2, 256).

    Poses and grids are not exact, so every pixel takes the lowest level within one pixel, hits and passed pixels alike.
    A map that does not depend on the scan thus has an AUROC of 0.5.

    Args:
        levels: levels of the pixels and of those around them, (P, 9).
        groups: what held-out beams show, by kind, G.
        pixels: flat indices of the pixels, (P,).
    """
    lowest = levels.min(1)
    masks = [mask.ravel()[pixels] for group in groups for mask in (group.hits, group.passed)]
    counts = [np.bincount(lowest[mask], minlength=LEVELS) for mask in masks]
    return np.stack(counts).reshape(len(groups), 2, LEVELS)


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


def rows_of(maps: dict[str, dict[str, Measured]], groups: tuple[str, ...], network: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table: the mean over the logs of each map and kind of pixels, then each log.

    `less_<measure>` is that of the network less that of the map, a positive one better for the AUROC and a negative one
    for the others. Means have intervals of 95 % from logs drawn with replacement, and within them blocks.

    Args:
        maps: what is measured, by the name of the map and that of the log.
        groups: names of the kinds of pixels, G.
        network: the map with which the others are compared.
    """
    values = {
        name: np.stack([drawn(measured, seed) for seed, measured in enumerate(logs.values())], axis=1)
        for name, logs in maps.items()
    }
    for name, logs in maps.items():
        means = mean_over_logs(values[name])
        less = mean_over_logs(values[network] - values[name])
        totals = np.stack([each.counts.sum((0, 3)) for each in logs.values()])  # (logs, G, 2)
        for number, group in enumerate(groups):
            defined = int(np.isfinite(values[name][0, :, number, 0]).sum())
            row: dict[str, Any] = {
                "map": name,
                "pixels": group,
                "log": MEAN,
                "windows": sum(each.windows for each in logs.values()),
            }
            row |= _sizes(totals[:, number].sum(0)) | {"logs": defined} | _intervals(MEASURES, means[:, number])
            if name != network:
                row |= _intervals([f"less_{each}" for each in MEASURES[:COMPARED]], less[:, number])
            yield row
    for name, logs in maps.items():
        for place, (log, measured) in enumerate(logs.items()):
            for number, group in enumerate(groups):
                row = {"map": name, "pixels": group, "log": log, "windows": measured.windows}
                row |= _sizes(measured.counts[:, number].sum((0, 2)))
                yield row | dict(zip(MEASURES, values[name][0, place, number], strict=True))


def _sizes(totals: np.ndarray) -> dict[str, int]:
    return {"hits": int(totals[0]), "passed": int(totals[1])}


def _intervals(names: Any, means: np.ndarray) -> dict[str, float]:
    """Return the value of each measure and its interval, from (draws + 1, measures)."""
    low, high = bounds(means)
    row: dict[str, float] = {}
    for number, name in enumerate(names):
        row |= {name: means[0, number], f"{name}_low": low[number], f"{name}_high": high[number]}
    return row
