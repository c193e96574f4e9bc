"""The paired comparison of two predictions of the same test recordings, of any method."""

import numpy as np
import pandas as pd
from torch import Tensor

from repro.evaluation.evaluate import checked_probabilities, measured_of
from repro.metrics.bootstrap import Measured, difference, draw_weights, resample
from repro.system.errors import InputError


def paired_differences(one: Tensor | np.ndarray, other: Tensor | np.ndarray, maps: Tensor) -> pd.DataFrame:
    """Compare two predictions by the differences of their metrics, with intervals of 95 % over the test worlds.

    The bootstrap draws the same worlds for both, each with its twin. The intervals do not include the variation over
    trainings.

    Args:
        one: probabilities of free in [0, 1], (M, 1, H, W), in the order of the test recordings.
        other: as `one`, of the method that it is compared with.
        maps: true maps, 1 is free, (M, 1, H, W), in which each world is followed by its twin.

    Returns:
        one row per metric: metric, value of `one` minus that of `other`, low, high, and excludes_zero, whether the
        interval excludes zero.

    Raises:
        ValueError: the shapes differ, the number of maps is odd, or a value is no probability.
    """
    if maps.ndim != 4 or maps.shape[1] != 1 or len(maps) % 2 or not len(maps):
        raise InputError(f"maps: expected the shape (M, 1, H, W) with an even M, got {tuple(maps.shape)}")
    weights = draw_weights(len(maps) // 2)
    drawn = [resample(_measured(name, free, maps), weights) for name, free in (("one", one), ("other", other))]
    return difference(*drawn)


def _measured(name: str, free: Tensor | np.ndarray, maps: Tensor) -> Measured:
    """Count the pixels of a prediction, as one seed."""
    try:
        return measured_of(checked_probabilities(free, maps), maps.cpu())
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
