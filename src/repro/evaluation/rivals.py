"""Rivals: predictors that learn nothing, to compare the networks with. Each is tuned on validation data alone."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from repro.evaluation.metrics import confusion, scores
from repro.maps.datasets import Pairs

Rival = Callable[[Pairs, Pairs], tuple[Tensor, dict[str, Any]]]


def all_free(val: Pairs, test: Pairs) -> tuple[Tensor, dict[str, Any]]:
    """Predicts that there is no obstacle."""
    return torch.ones(test.maps.shape), {}


def last_seen(val: Pairs, test: Pairs) -> tuple[Tensor, dict[str, Any]]:
    """Predicts an obstacle wherever a hit lies within a radius, the one that is best on the validation set."""
    radius_px = best_radius(val)
    return discs_around_hits(test, radius_px), {"radius_px": radius_px}


RIVALS: dict[str, Rival] = {"all_free": all_free, "last_seen": last_seen}


def best_radius(pairs: Pairs, largest_px: int = 8) -> int:
    """Finds the radius of 0 to `largest_px` pixels around hits that has the best obstacle IoU."""
    truth = pairs.maps.float()
    counts = [confusion(discs_around_hits(pairs, radius), truth).sum(0) for radius in range(largest_px + 1)]
    return int(np.argmax([scores(count)["obstacle_iou"] for count in counts]))


def discs_around_hits(pairs: Pairs, radius_px: int) -> Tensor:
    """Draws an obstacle wherever a hit lies within `radius_px` pixels, (M, 1, H, W); 1 is free."""
    reach = torch.arange(-radius_px, radius_px + 1)
    disc = (reach[:, None] ** 2 + reach**2 <= radius_px**2).float()
    return (F.conv2d(pairs.hits()[:, None].float(), disc[None, None], padding=radius_px) == 0).float()
