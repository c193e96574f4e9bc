"""Bootstrap intervals: variation of the metrics over test worlds and seeds.

Paired bootstrap over test worlds (Efron and Tibshirani, 1993). A world and its twin are drawn together, compared models
use the same draws, and every draw pools the metrics again. With several seeds, the seeds are resampled as well.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from repro.metrics.counts import confusion_of, scores_of

DRAWS = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Measured:
    """The test results of one network or baseline in one experiment, for each of its S seeds and W test worlds.

    Args:
        counts: number of pixels by truth and quantized probability in each world, (S, W, 2, 256).
        ssim: mean SSIM of the two images of each world, (S, W).
    """

    counts: np.ndarray
    ssim: np.ndarray


def draw_weights(worlds: int, draws: int = DRAWS) -> np.ndarray:
    """Draw the number of times each world is taken, (draws + 1, W); the first row takes every world once."""
    drawn = np.random.default_rng(0).multinomial(worlds, np.full(worlds, 1 / worlds), size=draws)
    return np.concatenate([np.ones((1, worlds), dtype=drawn.dtype), drawn])


def resample(measured: Measured, weights: np.ndarray) -> pd.DataFrame:
    """Compute every metric in every draw, averaged over seeds.

    Args:
        measured: the results of S seeds on W worlds.
        weights: see `draw_weights`, (draws + 1, W).

    Returns:
        one column per metric and one row per draw; row 0 is the measured value.
    """
    seeds, draws = len(measured.counts), len(weights)
    columns: dict[str, np.ndarray] = {"ssim": measured.ssim @ weights.T / weights.sum(1)}
    columns |= scores_of(np.einsum("bw,swc->sbc", weights, confusion_of(measured.counts), optimize=True))
    share = np.random.default_rng(1).multinomial(seeds, np.full(seeds, 1 / seeds), size=draws) / seeds
    share[0] = 1 / seeds
    return pd.DataFrame({name: (values * share.T).sum(0) for name, values in columns.items()})


def interval(drawn: pd.DataFrame) -> pd.DataFrame:
    """Return value, low and high (percentiles) of every metric, one row per column of `drawn`."""
    low, high = bounds(drawn.to_numpy())
    return pd.DataFrame({"metric": drawn.columns, "value": drawn.iloc[0].to_numpy(), "low": low, "high": high})


def bounds(drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high, each (...), the percentiles of draws (draws + 1, ...) without row 0, the measured value.

    Undefined draws (nan) count as infinity. A percentile between a finite and an infinite draw is infinity, and one
    between two infinite draws is nan, as `np.quantile` interpolates.
    """
    tail = (1 - LEVEL) / 2
    with np.errstate(invalid="ignore"):
        low, high = np.quantile(np.nan_to_num(drawn[1:], nan=np.inf, posinf=np.inf), [tail, 1 - tail], axis=0)
    return low, high


def difference(one: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """Return the interval of `one` - `other`, drawn with the same worlds; `excludes_zero`: zero is outside of it."""
    table = interval(one - other)
    return table.assign(excludes_zero=(table["low"] > 0) | (table["high"] < 0))


def by_world(values: np.ndarray) -> np.ndarray:
    """Sum values of single images, (M, ...), over each world and its twin, (M / 2, ...)."""
    return values.reshape(len(values) // 2, 2, *values.shape[1:]).sum(1)
