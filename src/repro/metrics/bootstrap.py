"""Intervals: how far a number would move with other test worlds, and other seeds.

The paired bootstrap of Efron and Tibshirani (1993) over test worlds: a world and its twin stay together, everything
that is compared is drawn with the same worlds, and the metrics are pooled anew in every draw. Where there are
several seeds, they are drawn too.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from repro.metrics.counts import pooled_scores

DRAWS = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Measured:
    """What is known of one network, or baseline, on the test worlds of an experiment, for each of its S seeds.

    Args:
        counts: pixels by truth and level, in each world, (S, W, 2, 256).
        ssim: the mean over the two images of each world, (S, W).
    """

    counts: np.ndarray
    ssim: np.ndarray


def draw_weights(worlds: int, seed: int = 0, draws: int = DRAWS) -> np.ndarray:
    """Draws how often each world is taken, (draws + 1, W); the first row is every world once."""
    drawn = np.random.default_rng(seed).multinomial(worlds, np.full(worlds, 1 / worlds), size=draws)
    return np.concatenate([np.ones((1, worlds), dtype=drawn.dtype), drawn])


def resample(measured: Measured, weights: np.ndarray, seed: int = 1) -> pd.DataFrame:
    """Computes every metric in every draw, the mean over seeds.

    Args:
        measured: of S seeds on W worlds.
        weights: see `draw_weights`, (draws + 1, W).
        seed: draws the seeds.

    Returns:
        one column a metric, one row a draw; row 0 is what was measured.
    """
    seeds, draws = len(measured.counts), len(weights)
    # Only the counts on either side of the threshold matter here: (S, W, 2, 256) to (S, W, 2, 2) is done by matmul
    columns: dict[str, np.ndarray] = {"ssim": measured.ssim @ weights.T / weights.sum(1)}
    pooled = np.einsum("bw,swtl->sbtl", weights, _halves(measured.counts), optimize=True)
    columns |= pooled_scores(_whole(pooled))
    share = np.random.default_rng(seed).multinomial(seeds, np.full(seeds, 1 / seeds), size=draws) / seeds
    share[0] = 1 / seeds
    return pd.DataFrame({name: (values * share.T).sum(0) for name, values in columns.items()})


def interval(drawn: pd.DataFrame, level: float = LEVEL) -> pd.DataFrame:
    """Gives value, low and high of every column, by percentiles; one row a column."""
    low, high = bounds(drawn.to_numpy(), level)
    return pd.DataFrame({"metric": drawn.columns, "value": drawn.iloc[0].to_numpy(), "low": low, "high": high})


def bounds(drawn: np.ndarray, level: float = LEVEL) -> tuple[np.ndarray, np.ndarray]:
    """Gives low and high, each (...), of draws (draws + 1, ...), by percentiles; row 0, what was measured, is no draw.

    A draw in which there is nothing to measure, nan, makes the interval end at infinity.
    """
    tail = (1 - level) / 2
    with np.errstate(invalid="ignore"):
        low, high = np.quantile(np.nan_to_num(drawn[1:], nan=np.inf, posinf=np.inf), [tail, 1 - tail], axis=0)
    return low, high


def difference(one: pd.DataFrame, other: pd.DataFrame, level: float = LEVEL) -> pd.DataFrame:
    """Gives the interval of `one` - `other`, drawn with the same worlds, and `excludes_zero`: it leaves out zero."""
    table = interval(one - other, level)
    return table.assign(excludes_zero=(table["low"] > 0) | (table["high"] < 0))


def by_world(values: np.ndarray) -> np.ndarray:
    """Sums what is known of each image, (M, ...), over a world and its twin, (M / 2, ...)."""
    return values.reshape(len(values) // 2, 2, *values.shape[1:]).sum(1)


def _halves(counts: np.ndarray) -> np.ndarray:
    """Sums levels on either side of the threshold, (..., 256) to (..., 2)."""
    return counts.reshape(*counts.shape[:-1], 2, counts.shape[-1] // 2).sum(-1)


def _whole(halves: np.ndarray) -> np.ndarray:
    """Puts sums of either side back on levels that lie there, (..., 2) to (..., 256)."""
    counts = np.zeros((*halves.shape[:-1], 256), dtype=halves.dtype)
    counts[..., 0], counts[..., 255] = halves[..., 0], halves[..., 1]
    return counts
