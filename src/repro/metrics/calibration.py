"""Calibration: agreement between predicted probabilities and observed frequencies.

All functions take pixel counts by quantized probability, (..., 2, 256) with obstacles first
(`metrics.counts.count_quantized`), and the probability of free of each quantized value, (256,). Sources: Murphy (1973)
for the decomposition of the Brier score, Guo et al. (2017) for the expected calibration error and temperature scaling.
"""

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar
from scipy.special import entr

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
    each = binary_entropy(PROBABILITY)
    return _mean(counts, np.stack([each, each]))


def binary_entropy(probability: np.ndarray) -> np.ndarray:
    """Compute the entropy of each probability [nat], (...)."""
    return entr(probability) + entr(1 - probability)


def reliability(counts: np.ndarray, probability: np.ndarray = PROBABILITY, bins: int = BINS) -> pd.DataFrame:
    """Compare predicted probability and observed frequency of obstacles in bins of equal width.

    Args:
        counts: pixels by truth and quantized probability, (2, 256).
        probability: probability of free of each quantized value, (256,).
        bins: number of bins.

    Returns:
        one row per non-empty bin: low, high, predicted (mean probability of an obstacle), found (observed share of
        obstacles), pixels.
    """
    predicted = 1 - probability
    number = np.minimum((predicted * bins).astype(int), bins - 1)
    pixels = np.bincount(number, counts.sum(0), bins)
    summed = np.bincount(number, counts.sum(0) * predicted, bins)
    obstacles = np.bincount(number, counts[0], bins)
    edges, kept = np.arange(bins + 1) / bins, pixels > 0
    with np.errstate(invalid="ignore"):
        columns = {"predicted": summed / pixels, "found": obstacles / pixels, "pixels": pixels.astype(np.int64)}
    return pd.DataFrame({"low": edges[:-1], "high": edges[1:], **columns})[kept].reset_index(drop=True)


def calibration_error(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> float:
    """Compute the expected calibration error of (2, 256): the mean gap between predicted and observed."""
    table = reliability(counts, probability)
    return float(((table["predicted"] - table["found"]).abs() * table["pixels"]).sum() / table["pixels"].sum())


def decompose_brier(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> dict[str, float]:
    """Split the Brier score of (2, 256) into reliability - resolution + uncertainty; one bin per quantized value."""
    pixels, total = counts.sum(0), counts.sum()
    observed = counts[1] / np.maximum(pixels, 1)
    base = counts[1].sum() / total
    return {
        "reliability": float((pixels * (probability - observed) ** 2).sum() / total),
        "resolution": float((pixels * (observed - base) ** 2).sum() / total),
        "uncertainty": float(base * (1 - base)),
    }


def fit_temperature(counts: np.ndarray) -> float:
    """Fit the temperature that minimizes the log-loss on (2, 256) when it divides the logits."""
    optimum = minimize_scalar(
        lambda log: float(log_loss(counts, temperature_scaled(np.exp(log)))), bounds=(-3, 3), method="bounded"
    )
    return float(np.exp(optimum.x))


def temperature_scaled(temperature: float) -> np.ndarray:
    """Return the probability of free of each quantized value after its logit is divided by a temperature, (256,)."""
    free = PROBABILITY.clip(_SMALLEST, 1 - _SMALLEST)
    return 1 / (1 + ((1 - free) / free) ** (1 / temperature))


def summary(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> dict[str, float]:
    """Compute all measures of calibration of (2, 256): Brier score and its parts, log-loss, calibration error."""
    return {
        "brier": float(brier(counts, probability)),
        **decompose_brier(counts, probability),
        "log_loss": float(log_loss(counts, probability)),
        "calibration_error": calibration_error(counts, probability),
    }


def _mean(counts: np.ndarray, each: np.ndarray) -> np.ndarray:
    """Average a loss (2, 256) over the pixels of (..., 2, 256); nan without pixels."""
    with np.errstate(invalid="ignore"):
        return (counts * each).sum((-2, -1)) / counts.sum((-2, -1))
