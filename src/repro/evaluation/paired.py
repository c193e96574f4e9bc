"""The paired comparison of two predictions of the same test recordings, of any method."""

import numpy as np

from repro.evaluation.image_metrics import measured_of
from repro.metrics.bootstrap import Difference, Measured, differences, draw_weights, resample
from repro.metrics.scores import checked_probabilities
from repro.system.errors import InputError


def paired_differences(one: np.ndarray, other: np.ndarray, maps: np.ndarray) -> list[Difference]:
    """Compare two predictions by the differences of their metrics, with intervals of 95 % over the test worlds.

    The bootstrap draws the same worlds for both, each with its twin. The intervals do not include the variation over
    trainings.

    Args:
        one: probabilities of free in [0, 1], (M, 1, H, W), in the order of the test recordings.
        other: as `one`, of the method that it is compared with.
        maps: true maps, 1 is free, (M, 1, H, W), in which each world is followed by its twin.

    Returns:
        for each metric, the value of `one` minus that of `other` with its interval; `pandas.DataFrame` takes the list.

    Raises:
        InputError: the shapes differ, the number of maps is odd, or a value is no probability.
    """
    if maps.ndim != 4 or maps.shape[1] != 1 or len(maps) % 2 or not len(maps):
        raise InputError(f"maps: expected the shape (M, 1, H, W) with an even M, got {maps.shape}")
    if not ((maps == 0) | (maps == 1)).all():
        raise InputError("maps: expected 0 and 1, which is free, got other values")
    weights = draw_weights(len(maps) // 2)
    return differences(*(resample(_measured(*named, maps), weights) for named in (("one", one), ("other", other))))


def _measured(name: str, free: np.ndarray, maps: np.ndarray) -> Measured:
    """Count the pixels of a prediction, as one seed."""
    try:
        return measured_of(checked_probabilities(free, maps), maps)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
