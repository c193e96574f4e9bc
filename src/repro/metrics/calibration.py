"""Calibration: whether a predicted probability is the share of times it comes true.

All of it from counts of predicted levels, (..., 2, 256) with obstacles first (`levels.count_quantized`), and the
probability of free that each level stands for, (256,). Formulas: Murphy (1973) for the decomposition of the Brier
score, Guo et al. (2017) for the expected calibration error and for temperature scaling.
"""

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from repro.metrics.counts import LEVELS, PROBABILITY

BINS = 15
_SMALLEST = 0.5 / (LEVELS - 1)  # a level of 0 stands for anything below this


def brier(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> np.ndarray:
    """Computes the Brier score, the mean squared error of the probability, (...)."""
    return _mean(counts, np.stack([probability**2, (1 - probability) ** 2]))


def log_loss(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> np.ndarray:
    """Computes the negative log-likelihood of a pixel [nat], (...); probabilities are kept off 0 and 1 by 1/510."""
    free = probability.clip(_SMALLEST, 1 - _SMALLEST)
    return _mean(counts, -np.log(np.stack([1 - free, free])))


def entropy(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> np.ndarray:
    """Computes the mean entropy of the predicted probabilities [nat], (...): how blurry a prediction is."""
    free = probability.clip(1e-12, 1 - 1e-12)
    each = -(free * np.log(free) + (1 - free) * np.log(1 - free))
    return _mean(counts, np.stack([each, each]))


def reliability(counts: np.ndarray, probability: np.ndarray = PROBABILITY, bins: int = BINS) -> pd.DataFrame:
    """Compares predicted probability and frequency of obstacles, in bins of equal width.

    Args:
        counts: (2, 256).
        probability: of free at each level.
        bins: how many.

    Returns:
        one row a bin that is not empty: low, high, predicted (mean probability of an obstacle), found (share that are
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


def calibration_error(counts: np.ndarray, probability: np.ndarray = PROBABILITY, bins: int = BINS) -> float:
    """Computes the expected calibration error of (2, 256): the mean gap between predicted and found."""
    table = reliability(counts, probability, bins)
    return float(((table["predicted"] - table["found"]).abs() * table["pixels"]).sum() / table["pixels"].sum())


def decompose_brier(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> dict[str, float]:
    """Splits the Brier score of (2, 256) into reliability - resolution + uncertainty, exactly, a bin a level."""
    pixels, total = counts.sum(0), counts.sum()
    found = counts[1] / np.maximum(pixels, 1)
    base = counts[1].sum() / total
    return {
        "reliability": float((pixels * (probability - found) ** 2).sum() / total),
        "resolution": float((pixels * (found - base) ** 2).sum() / total),
        "uncertainty": float(base * (1 - base)),
    }


def fit_temperature(counts: np.ndarray) -> float:
    """Finds the temperature by which logits are to be divided for the lowest log-loss on (2, 256)."""
    found = minimize_scalar(
        lambda log: float(log_loss(counts, temperature_scaled(np.exp(log)))), bounds=(-3, 3), method="bounded"
    )
    return float(np.exp(found.x))


def temperature_scaled(temperature: float) -> np.ndarray:
    """Gives the probability of free at each level after its logit is divided by a temperature, (256,)."""
    free = PROBABILITY.clip(_SMALLEST, 1 - _SMALLEST)
    return 1 / (1 + ((1 - free) / free) ** (1 / temperature))


def summary(counts: np.ndarray, probability: np.ndarray = PROBABILITY) -> dict[str, float]:
    """Gathers the calibration of (2, 256) in one row: Brier score and its parts, log-loss, calibration error."""
    return {
        "brier": float(brier(counts, probability)),
        **decompose_brier(counts, probability),
        "log_loss": float(log_loss(counts, probability)),
        "calibration_error": calibration_error(counts, probability),
    }


def _mean(counts: np.ndarray, each: np.ndarray) -> np.ndarray:
    """Averages a loss (2, 256) over the pixels of (..., 2, 256); nan where there are none."""
    with np.errstate(invalid="ignore"):
        return (counts * each).sum((-2, -1)) / counts.sum((-2, -1))
