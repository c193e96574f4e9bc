"""Bootstrap intervals: variation of the metrics over test worlds and seeds.

Paired bootstrap over test worlds (Efron and Tibshirani, 1993). A world and its twin are drawn together, compared models
use the same draws, and every draw pools the metrics again. With several seeds, the seeds are resampled as well.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from repro.metrics.counts import confusion_of
from repro.metrics.scores import scores

DRAWS = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Measured:
    """The test results of one network or baseline in one experiment, for each of its S seeds and W test worlds.

    Args:
        counts: number of pixels by truth and quantized probability in each world, (S, W, 2, 256).
        per_world: means of metrics of images over the two images of each world, each (S, W).
    """

    counts: np.ndarray
    per_world: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Interval:
    """A metric and its interval of 95 %; low and high are percentiles of its draws."""

    metric: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Difference(Interval):
    """The difference of a metric between two predictions, and whether its interval excludes zero."""

    excludes_zero: bool


def draw_weights(worlds: int, draws: int = DRAWS) -> np.ndarray:
    """Draw the number of times each world is taken, (draws + 1, W); the first row takes every world once."""
    drawn = np.random.default_rng(0).multinomial(worlds, np.full(worlds, 1 / worlds), size=draws)
    return np.concatenate([np.ones((1, worlds), dtype=drawn.dtype), drawn])


def resample(measured: Measured, weights: np.ndarray) -> dict[str, np.ndarray]:
    """Compute every metric in every draw, averaged over seeds.

    Args:
        measured: the results of S seeds on W worlds.
        weights: see `draw_weights`, (draws + 1, W).

    Returns:
        the draws of each metric by its name, (draws + 1,); the first is the measured value.
    """
    seeds, draws = len(measured.counts), len(weights)
    metrics = {name: values @ weights.T / weights.sum(1) for name, values in measured.per_world.items()}
    metrics |= scores(np.einsum("bw,swc->sbc", weights, confusion_of(measured.counts), optimize=True))
    share = np.random.default_rng(1).multinomial(seeds, np.full(seeds, 1 / seeds), size=draws) / seeds
    share[0] = 1 / seeds
    return {name: (values * share.T).sum(0) for name, values in metrics.items()}


def intervals(drawn: Mapping[str, np.ndarray]) -> list[Interval]:
    """Return the interval of each metric from its draws, see `resample`."""
    low, high = bounds(np.stack(list(drawn.values()), axis=1))
    values = zip(drawn, (float(draws[0]) for draws in drawn.values()), low.tolist(), high.tolist(), strict=True)
    return [Interval(*row) for row in values]


def bounds(drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high, each (...), the percentiles of draws (draws + 1, ...) without row 0, the measured value.

    Undefined draws (nan) count as infinity. A percentile between a finite and an infinite draw is infinity, and one
    between two infinite draws is nan, as `np.quantile` interpolates.
    """
    tail = (1 - LEVEL) / 2
    with np.errstate(invalid="ignore"):
        low, high = np.quantile(np.nan_to_num(drawn[1:], nan=np.inf, posinf=np.inf), [tail, 1 - tail], axis=0)
    return low, high


def differences(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> list[Difference]:
    """Return the interval of `one` - `other` for each metric, whose draws took the same worlds."""
    found = intervals({name: draws - other[name] for name, draws in one.items()})
    return [Difference(**vars(gain), excludes_zero=gain.low > 0 or gain.high < 0) for gain in found]


def by_world(values: np.ndarray) -> np.ndarray:
    """Sum values of single images, (M, ...), over each world and its twin, (M / 2, ...)."""
    return values.reshape(len(values) // 2, 2, *values.shape[1:]).sum(1)
