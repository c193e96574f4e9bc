"""Rivals: predictors made by hand, to compare the networks with. Each is tuned on validation data alone.

A rival takes the validation and the test recordings and returns the probability of free, (M, 1, H, W), of the
test recordings, and what was tuned. The `QUICK` ones stand in the tables beside the networks; the others are evaluated
with the evidence (`task=evidence`).
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from repro.evaluation.metrics import confusion, scores
from repro.maps.datasets import Recorded
from repro.maps.projection import newest_hits

Rival = Callable[[Recorded, Recorded], tuple[Tensor, dict[str, Any]]]
RADII_M = tuple(0.5 * number for number in range(10))  # around what was hit


def all_free(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predicts that there is no obstacle."""
    return torch.ones(test.maps.shape), {}


def last_seen(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predicts an obstacle wherever a hit lies within a radius."""
    return tune(lambda each, radius_px: grow(_hits(each), radius_px), {"radius_px": range(9)}, val, test)


def occupancy(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predicts by a log-odds occupancy grid that forgets; see `grids.log_odds`."""
    from repro.evaluation.grids import log_odds

    settings = {"forgetting": (0.0, 0.005, 0.02, 0.05), "radius_m": RADII_M[:6]}
    return tune(_grown(log_odds, "forgetting"), settings, val, test)


def transitional(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predicts by a grid of static and dynamic occupancy; see `grids.transitional`."""
    from repro.evaluation.grids import transitional as filtered

    settings = {"moving": (0.02, 0.1, 0.3), "radius_m": RADII_M[:6]}
    return tune(_grown(filtered, "moving"), settings, val, test)


def tracker(val: Recorded, test: Recorded) -> tuple[Tensor, dict[str, Any]]:
    """Predicts by tracking clusters of hits; see `tracking.track`."""
    from repro.evaluation.tracking import draw, track

    known: dict[tuple[int, float], Any] = {}

    def predict(each: Recorded, depth_m: float, radius_m: float) -> Tensor:
        key = (id(each), depth_m)
        if key not in known:
            known[key] = track(each, depth_m)
        return draw(known[key], each.grid, radius_m)

    return tune(predict, {"depth_m": (1.0, 2.0, 3.0), "radius_m": RADII_M[2:8]}, val, test)


QUICK = ("all_free", "last_seen")
RIVALS: dict[str, Rival] = {
    "all_free": all_free,
    "last_seen": last_seen,
    "occupancy": occupancy,
    "transitional": transitional,
    "tracker": tracker,
}


def tune(
    predict: Callable[..., Tensor], settings: Mapping[str, Iterable[float]], val: Recorded, test: Recorded
) -> tuple[Tensor, dict[str, Any]]:
    """Predicts with the settings that have the best obstacle IoU on the validation set.

    Args:
        predict: from recordings and settings to the probability of free, (M, 1, H, W).
        settings: the values to try of each.
        val: the validation recordings.
        test: the test recordings.
    """
    tried = [dict(zip(settings, values, strict=True)) for values in itertools.product(*settings.values())]
    best = max(tried, key=lambda words: _obstacle_iou(predict(val, **words), val))
    return predict(test, **best), best


def grow(occupied: Tensor, radius_px: int) -> Tensor:
    """Gives every pixel the highest value within `radius_px` pixels, and from occupied makes free, (M, 1, H, W)."""
    reach = range(-radius_px, radius_px + 1)
    disc = [(dy, dx) for dy in reach for dx in reach if dy**2 + dx**2 <= radius_px**2]
    padded = torch.nn.functional.pad(occupied.float(), [radius_px] * 4)
    height, width = occupied.shape[-2:]
    grown = occupied.float()
    for dy, dx in disc:
        top, left = radius_px + dy, radius_px + dx
        grown = torch.maximum(grown, padded[..., top : top + height, left : left + width])
    return 1 - grown[:, None]


def _obstacle_iou(probability: Tensor, recorded: Recorded) -> float:
    return scores(confusion(probability, recorded.maps.float()).sum(0))["obstacle_iou"].item()


def _hits(recorded: Recorded) -> Tensor:
    return newest_hits(recorded.scans, recorded.grid) > 0


def _grown(filtered: Callable[[Recorded, float], Tensor], word: str) -> Callable[..., Tensor]:
    """Makes a predictor of a grid filter: its occupancy is computed once a value of `word`, then grown by a radius."""
    known: dict[tuple[int, float], Tensor] = {}

    def predict(each: Recorded, radius_m: float, **words: float) -> Tensor:
        key = (id(each), words[word])
        if key not in known:
            known[key] = filtered(each, words[word])
        return grow(known[key], int(np.rint(radius_m / each.grid.resolution_m)))

    return predict
