"""Calibration: agreement between predicted probabilities and observed frequencies.

All functions take pixel counts by quantized probability, (..., 2, 256) with obstacles first
(`metrics.counts.count_quantized`). Source: Guo et al. (2017) for the expected calibration error.
"""

from dataclasses import dataclass

import numpy as np

from repro.metrics.counts import LEVELS, PROBABILITY

BINS = 15
_SMALLEST = 0.5 / (LEVELS - 1)  # probabilities below this are quantized to 0


def brier(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> np.ndarray:
    """Compute the Brier score, the mean squared error of the probability, (...)."""
    return _mean(counts, np.stack([probability**2, (1 - probability) ** 2]))


def log_loss(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> np.ndarray:
    """Compute the negative log-likelihood of a pixel [nat], (...); probabilities are clipped to [1/510, 509/510]."""
    free = probability.clip(_SMALLEST, 1 - _SMALLEST)
    return _mean(counts, -np.log(np.stack([1 - free, free])))


def entropy(counts: np.ndarray) -> np.ndarray:
    """Compute the mean entropy of the predicted probabilities [nat], (...), a measure of blur."""
    surprise = -PROBABILITY * np.log(np.where(PROBABILITY > 0, PROBABILITY, 1))
    both = surprise + surprise[::-1]  # of free and of an obstacle
    return _mean(counts, np.stack([both, both]))


@dataclass(frozen=True)
class Reliability:
    """A reliability diagram: one value per non-empty bin of the predicted probability of an obstacle, each (B,).

    Args:
        low: lower edge of the bin.
        high: upper edge of the bin.
        predicted: mean predicted probability of an obstacle.
        observed: observed share of obstacles.
        pixels: number of pixels.
    """

    low: np.ndarray
    high: np.ndarray
    predicted: np.ndarray
    observed: np.ndarray
    pixels: np.ndarray

    def uncertain(self) -> "Reliability":
        """Return the bins of uncertain predictions: all but the first and the last, from 1/15 to 14/15."""
        inside = (self.low > 0) & (self.high < 1)
        return Reliability(*(values[inside] for values in vars(self).values()))


def reliability(counts: np.ndarray) -> Reliability:
    """Compare predicted probability and observed frequency of obstacles in 15 bins of equal width, from (2, 256)."""
    predicted = 1 - PROBABILITY
    number = np.minimum((predicted * BINS).astype(int), BINS - 1)
    pixels = np.bincount(number, counts.sum(0), BINS)
    summed = np.bincount(number, counts.sum(0) * predicted, BINS)
    obstacles = np.bincount(number, counts[0], BINS)
    edges, kept = np.arange(BINS + 1) / BINS, pixels > 0
    columns = (edges[:-1], edges[1:], summed / pixels.clip(1), obstacles / pixels.clip(1), pixels.astype(np.int64))
    return Reliability(*(values[kept] for values in columns))


def calibration_error(diagram: Reliability) -> float:
    """Compute the expected calibration error, the mean gap between predicted and observed; nan without pixels."""
    gap = np.abs(diagram.predicted - diagram.observed)
    return _weighted(gap, diagram.pixels)


def uncertain_error(diagram: Reliability) -> float:
    """Compute the calibration error of uncertain predictions; over all pixels it is small for any sure prediction."""
    return calibration_error(diagram.uncertain())


def uncertain_skill(diagram: Reliability) -> float:
    """Compute the Brier skill of uncertain predictions against the share of obstacles among them; nan without pixels.

    It is 0 for a calibrated constant, 1 for a perfect prediction; the spread within a bin is neglected.
    """
    own = diagram.uncertain()
    base = _weighted(own.observed, own.pixels)
    resolution, gaps = ((own.observed - other) ** 2 for other in (base, own.predicted))
    with np.errstate(invalid="ignore", divide="ignore"):
        return float((_weighted(resolution, own.pixels) - _weighted(gaps, own.pixels)) / np.float64(base * (1 - base)))


def _weighted(values: np.ndarray, pixels: np.ndarray) -> float:
    return float(np.average(values, weights=pixels)) if pixels.sum() else float("nan")


def summary(counts: np.ndarray) -> dict[str, float]:
    """Compute all measures of calibration of (2, 256): Brier score, log-loss, calibration errors."""
    diagram = reliability(counts)
    return {
        "brier": float(brier(counts)),
        "log_loss": float(log_loss(counts)),
        "calibration_error": calibration_error(diagram),
        "uncertain_error": uncertain_error(diagram),
    }


def _mean(counts: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Average a loss (2, 256) over the pixels of (..., 2, 256); nan without pixels."""
    with np.errstate(invalid="ignore"):
        return (counts * values).sum((-2, -1)) / counts.sum((-2, -1))
