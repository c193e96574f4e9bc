"""The paper's six metrics, and the same metrics with obstacles as the positive class.

The paper's positive class is FREE space (see reporting/paper_tables: every row of its tables implies the same
prevalence in two independent ways). We pool the counts over the test set, which the paper does not state: DEVIATIONS
D10. Formulas and eps follow Segmentation-Metrics-PyTorch, which the paper names.
"""

import numpy as np

from repro.system.errors import InputError

THRESHOLD = 0.5
EPS = 1e-5  # Segmentation-Metrics-PyTorch adds it to numerator and denominator


def checked_probabilities(free: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Return predictions in float32 after a check.

    Args:
        free: probability of free, (M, 1, H, W).
        maps: the true maps, (M, 1, H, W).

    Raises:
        InputError: they are no probabilities of free, or their shape is not that of the maps.
    """
    if not isinstance(free, np.ndarray) or free.shape != maps.shape:
        got = tuple(getattr(free, "shape", ())) or type(free).__name__
        raise InputError(f"expected probabilities of free, {maps.shape} as the maps, got {got}")
    probability = free.astype(np.float32)
    if not ((probability >= 0) & (probability <= 1)).all():
        low, high = probability.min(), probability.max()
        raise InputError(
            f"expected probabilities of free from 0 to 1, got values from {low:g} to {high:g}: logits need a sigmoid"
        )
    return probability


def scores(counts: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the metrics of counts (..., 4), see `counts.confusion_of`, each (...).

    Returns:
        accuracy; dice, precision, recall and specificity with FREE as the positive class; obstacle_dice,
        obstacle_precision and obstacle_iou with OBSTACLE as the positive class, whose recall is the specificity.
    """
    tp, fp, tn, fn = np.moveaxis(np.asarray(counts, dtype=float), -1, 0)
    shares = {
        "accuracy": (tp + tn, tp + fp + tn + fn),
        "dice": (2 * tp, 2 * tp + fp + fn),
        "precision": (tp, tp + fp),
        "recall": (tp, tp + fn),
        "specificity": (tn, tn + fp),
        "obstacle_dice": (2 * tn, 2 * tn + fn + fp),
        "obstacle_precision": (tn, tn + fn),
        "obstacle_iou": (tn, tn + fp + fn),
    }
    return {name: (part + EPS) / (whole + EPS) for name, (part, whole) in shares.items()}
