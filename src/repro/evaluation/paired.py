"""The paired comparison of two predictions of the same test recordings, of any method."""

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from repro.evaluation.evaluate import measured_of
from repro.metrics.bootstrap import Measured, difference, draw_weights, resample


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
        raise ValueError(f"maps: expected the shape (M, 1, H, W) with an even M, got {tuple(maps.shape)}")
    weights = draw_weights(len(maps) // 2)
    drawn = [resample(_measured(name, free, maps), weights) for name, free in (("one", one), ("other", other))]
    return difference(*drawn)


def _measured(name: str, free: Tensor | np.ndarray, maps: Tensor) -> Measured:
    """Count the pixels of a prediction, as one seed."""
    free, truth = torch.as_tensor(free).cpu().float(), maps.cpu()
    if free.shape != truth.shape:
        raise ValueError(f"{name}: expected the shape of the maps, {tuple(truth.shape)}, got {tuple(free.shape)}")
    if not ((free >= 0) & (free <= 1)).all():
        low, high = free.min().item(), free.max().item()
        raise ValueError(f"{name}: expected probabilities from 0 to 1, got values from {low:g} to {high:g}")
    return measured_of(free, truth)
