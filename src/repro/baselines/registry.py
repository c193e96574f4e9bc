"""Classical baselines to compare the networks with, each tuned on the validation set, and an upper bound.

A baseline maps the validation and the test recordings to the probability of free of the test recordings,
(M, 1, H, W), and the tuned settings. A new baseline needs a function here, an entry in `PREDICTORS` and its title in
`baselines.names`.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
import torch
from scipy.ndimage import grey_dilation
from torch import Tensor

from repro.baselines.inference import infer
from repro.baselines.occupancy_grids import log_odds_grid, transitional_grid
from repro.baselines.privileged import Knowledge, privileged
from repro.baselines.tracker import draw, track
from repro.maps.datasets import Recorded
from repro.maps.projection import newest_hits
from repro.metrics.scores import confusion, scores

Settings = dict[str, Any]
Baseline = Callable[[Recorded, Recorded], tuple[Tensor, Settings]]
RADII_M = tuple(0.5 * number for number in range(8))  # radii around hits, up to 3.5 m


def all_free(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict free space everywhere."""
    return torch.ones(test.maps.shape), {}


def last_seen(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict an obstacle within a radius of every hit."""
    radii_px = range(1 + int(RADII_M[-1] / val.grid.resolution_m))
    return tune(lambda each, radius_px: dilate(_hits(each), radius_px), {"radius_px": radii_px}, val, test)


def occupancy(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict with a log-odds occupancy grid with forgetting; see `occupancy_grids.log_odds_grid`."""
    settings = {"forgetting": (0.0, 0.005, 0.02, 0.05), "radius_m": RADII_M}
    return tune(_dilated(log_odds_grid, "forgetting"), settings, val, test)


def transitional(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict with a grid of static and dynamic occupancy; see `occupancy_grids.transitional_grid`."""
    settings = {"moving": (0.02, 0.1, 0.3), "radius_m": RADII_M}
    return tune(_dilated(transitional_grid, "moving"), settings, val, test)


def tracker(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict by tracking clusters of hits; see `tracker.track`."""
    tracks: dict[tuple[int, float], Any] = {}

    def predict(each: Recorded, depth_m: float, radius_m: float) -> Tensor:
        key = (id(each), depth_m)
        if key not in tracks:
            tracks[key] = track(each, depth_m)
        return draw(tracks[key], each.grid, radius_m)

    return tune(predict, {"depth_m": (1.0, 2.0, 3.0), "radius_m": RADII_M[2:]}, val, test)


PREDICTORS: dict[str, Baseline] = {
    "all_free": all_free,
    "last_seen": last_seen,
    "occupancy": occupancy,
    "transitional": transitional,
    "tracker": tracker,
    "privileged": privileged,
    "with_unseen": partial(privileged, knowledge=Knowledge(unseen=True)),
    "without_shapes": partial(privileged, knowledge=Knowledge(shapes=False)),
    "without_velocities": partial(privileged, knowledge=Knowledge(velocities=False)),
    "positions": partial(privileged, knowledge=Knowledge(shapes=False, velocities=False)),
    "inference": infer,
}


def tune(
    predict: Callable[..., Tensor], settings: Mapping[str, Iterable[float]], val: Recorded, test: Recorded
) -> tuple[Tensor, Settings]:
    """Predict the test set with the settings that have the best obstacle IoU on the validation set.

    Args:
        predict: function from recordings and settings to the probability of free, (M, 1, H, W).
        settings: the candidate values of each setting.
        val: the validation recordings.
        test: the test recordings.

    Returns:
        the probability of free of the test recordings, (M, 1, H, W), and the chosen settings.
    """
    candidates = [dict(zip(settings, values, strict=True)) for values in itertools.product(*settings.values())]
    best = max(candidates, key=lambda chosen: _obstacle_iou(predict(val, **chosen), val))
    return predict(test, **best), best


def dilate(occupied: Tensor, radius_px: int) -> Tensor:
    """Dilate occupancy by a disc.

    Args:
        occupied: probability of an obstacle, (M, H, W).
        radius_px: radius of the disc [px].

    Returns:
        probability of free, (M, 1, H, W): one minus the highest occupancy within the radius.
    """
    reach = np.arange(-radius_px, radius_px + 1)
    disc = np.square(reach[:, None]) + np.square(reach) <= radius_px**2
    dilated = grey_dilation(occupied.float().numpy(), footprint=disc[None], mode="constant", cval=0.0)
    return 1 - torch.from_numpy(dilated)[:, None]


def _obstacle_iou(probability: Tensor, recorded: Recorded) -> float:
    return scores(confusion(probability, recorded.maps.float()).sum(0))["obstacle_iou"].item()


def _hits(recorded: Recorded) -> Tensor:
    return newest_hits(recorded.scans, recorded.grid) > 0


def _dilated(grid_filter: Callable[[Recorded, float], Tensor], setting: str) -> Callable[..., Tensor]:
    """Return a predictor that filters a grid, once per value of `setting`, and dilates its occupancy by a radius."""
    occupancies: dict[tuple[int, float], Tensor] = {}

    def predict(each: Recorded, radius_m: float, **settings: float) -> Tensor:
        key = (id(each), settings[setting])
        if key not in occupancies:
            occupancies[key] = grid_filter(each, settings[setting])
        return dilate(occupancies[key], int(np.rint(radius_m / each.grid.resolution_m)))

    return predict
