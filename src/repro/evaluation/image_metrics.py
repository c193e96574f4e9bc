"""Metrics of single images, of which a test set has the mean, and the measures of a prediction that need them."""

from collections.abc import Callable

import numpy as np

from repro.metrics.bootstrap import Measured, by_world
from repro.metrics.counts import counts_of
from repro.metrics.headings import GROUP, TABLE_METRICS
from repro.metrics.scores import THRESHOLD, scores
from repro.system.errors import InputError
from repro.system.plugins import plugins


def ssim(probability: np.ndarray, target: np.ndarray, batch: int = 64) -> np.ndarray:
    """Compute the structural similarity (piqa, window of 11 px) of images (M, 1, H, W) in [0, 1], (M,)."""
    import torch  # these take seconds, and who reads results computes none
    from piqa import SSIM

    measure = SSIM(n_channels=1, reduction="none")
    one, other = (torch.from_numpy(np.asarray(images, np.float32)).split(batch) for images in (probability, target))
    return torch.cat([measure(*pair) for pair in zip(one, other, strict=True)]).numpy()


IMAGE_METRICS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "ssim": ssim,
    "ssim_binary": lambda probability, target: ssim(probability >= THRESHOLD, target),
}  # of each image, (M,), from probabilities of free and true maps, (M, 1, H, W); a test set has their mean
IMAGE_METRICS |= plugins(GROUP, (*IMAGE_METRICS, *scores(np.ones(4))))
IN_INTERVALS = tuple(name for name in IMAGE_METRICS if name in TABLE_METRICS)


def of_images(name: str, probability: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Compute a metric of each image, (M,).

    Raises:
        InputError: its values are not one finite number for each image.
    """
    values = np.asarray(IMAGE_METRICS[name](probability, maps))
    if values.shape != (len(maps),) or not np.isfinite(values).all():
        raise InputError(
            f"metric {name}: expected one finite number for each of {len(maps)} images, got shape {values.shape}, of "
            f"which {np.isfinite(values).sum()} are finite"
        )
    return values


def measured_of(probability: np.ndarray, maps: np.ndarray) -> Measured:
    """Count the pixels of quantized probabilities and compute the metrics of images by world, as one seed.

    Args:
        probability: probability of free, (M, 1, H, W), in [0, 1].
        maps: true maps, (M, 1, H, W); recordings 2 w and 2 w + 1 are of world w.
    """
    return Measured(
        by_world(counts_of(probability, maps))[None],
        {name: by_world(of_images(name, probability, maps))[None] / 2 for name in IN_INTERVALS},
    )
