"""The paper's six metrics, and the same seen from the obstacles.

The paper's positive class is FREE space (reporting/paper_tables: from every row of its tables the same prevalence
follows twice), and its counts are pooled over the test set: DEVIATIONS D10. Formulas and eps are those of
Segmentation-Metrics-PyTorch, which the paper names; SSIM is piqa's.
"""

import torch
from piqa import SSIM
from torch import Tensor

EPS = 1e-5  # Segmentation-Metrics-PyTorch adds it to numerator and denominator


def confusion(probability: Tensor, target: Tensor, threshold: float = 0.5) -> Tensor:
    """Counts pixels with FREE as the positive class.

    Args:
        probability: predicted probability of free, (M, 1, H, W).
        target: true map with 1 = free, (M, 1, H, W).
        threshold: a pixel above it is predicted free.

    Returns:
        true positives, false positives, true negatives, false negatives of each image, int64, (M, 4).
    """
    free, truth = probability > threshold, target > 0.5
    pairs = (free & truth, free & ~truth, ~free & ~truth, ~free & truth)
    return torch.stack([pair.flatten(1).sum(1) for pair in pairs], dim=1)


def scores(counts: Tensor) -> dict[str, Tensor]:
    """Computes metrics from counts (..., 4): accuracy, Dice, precision, recall, specificity with FREE as positive,
    the last four with OBSTACLE as positive, and obstacle IoU, each (...)."""
    tp, fp, tn, fn = counts.double().unbind(-1)
    free = _scores(tp, fp, tn, fn)
    obstacle = _scores(tn, fn, tp, fp)
    return {
        "accuracy": (tp + tn + EPS) / (tp + fp + tn + fn + EPS),
        **free,
        **{f"obstacle_{name}": value for name, value in obstacle.items()},
        "obstacle_iou": (tn + EPS) / (tn + fp + fn + EPS),
    }


def _scores(tp: Tensor, fp: Tensor, tn: Tensor, fn: Tensor) -> dict[str, Tensor]:
    return {
        "dice": (2 * tp + EPS) / (2 * tp + fp + fn + EPS),
        "precision": (tp + EPS) / (tp + fp + EPS),
        "recall": (tp + EPS) / (tp + fn + EPS),
        "specificity": (tn + EPS) / (tn + fp + EPS),
    }


def ssim(probability: Tensor, target: Tensor, batch: int = 64) -> Tensor:
    """Measures structural similarity by piqa, window 11, of images (M, 1, H, W) in [0, 1], each (M,)."""
    measure = SSIM(n_channels=1, reduction="none").to(probability.device)
    pairs = zip(probability.float().split(batch), target.float().split(batch), strict=True)
    return torch.cat([measure(p, t) for p, t in pairs])
