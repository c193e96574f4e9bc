"""Pixel counts by truth and quantized probability, from which all metrics of a prediction are computed.

Predictions are stored as uint8: 255 is certainly free, 0 certainly an obstacle. The counts, an array (..., 2, 256) with
obstacles first, determine the paper's metrics at any threshold and the calibration. Counts
of single worlds, summed with weights, give the bootstrap (`metrics.bootstrap`).
"""

import numpy as np

from repro.metrics.scores import THRESHOLD, scores

LEVELS = 256  # number of quantized probability values
PROBABILITY = np.arange(LEVELS) / (LEVELS - 1)  # of free, for each quantized value


def quantize(probability: np.ndarray) -> np.ndarray:
    """Quantize probabilities (M, 1, H, W) in [0, 1] to uint8, 0 to 255, (M, H, W)."""
    return np.rint(np.asarray(probability, np.float32)[:, 0] * 255).astype(np.uint8)


def count_quantized(
    free: np.ndarray, truth: np.ndarray, groups: np.ndarray | None = None, number: int = 1
) -> np.ndarray:
    """Count the pixels of every image by group, truth and quantized probability value 0..255.

    Args:
        free: quantized probabilities of free, uint8, (M, H, W).
        truth: true maps, 1 is free, (M, H, W).
        groups: the group of each pixel in [0, number), (M, H, W); None puts all pixels into one group.
        number: number of groups, G.

    Returns:
        int64 counts, (M, G, 2, 256).
    """
    counts = np.zeros((len(free), number * 2 * LEVELS), dtype=np.int64)
    for index, (image, true) in enumerate(zip(free, truth, strict=True)):
        group = 0 if groups is None else groups[index].astype(np.int64)
        index_flat = ((group * 2 + true.astype(np.int64)) * LEVELS + image).ravel()
        counts[index] = np.bincount(index_flat, minlength=counts.shape[1])
    return counts.reshape(len(free), number, 2, LEVELS)


def counts_of(probability: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Count the pixels of every image from probabilities of free and true maps, both (M, 1, H, W), (M, 2, 256)."""
    return count_quantized(quantize(probability), maps[:, 0])[:, 0]


def confusion_of(counts: np.ndarray) -> np.ndarray:
    """Count true and false positives, true and false negatives with FREE as positive, (..., 4), from (..., 2, 256)."""
    is_free = PROBABILITY >= THRESHOLD
    free, obstacle = counts[..., 1, :], counts[..., 0, :]
    parts = (free[..., is_free], obstacle[..., is_free], obstacle[..., ~is_free], free[..., ~is_free])
    return np.stack([part.sum(-1) for part in parts], axis=-1)


def pooled_scores(counts: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the metrics of `metrics.scores` at threshold 0.5 from (..., 2, 256), each (...)."""
    return scores(confusion_of(counts))


def best_iou(counts: np.ndarray) -> np.ndarray:
    """Compute the IoU of obstacles at the threshold that maximizes it, (...), from (..., 2, 256)."""
    obstacle, free = np.cumsum(counts[..., 0, :], -1), np.cumsum(counts[..., 1, :], -1)
    return (obstacle / np.maximum(obstacle[..., -1:] + free, 1)).max(-1)
