"""Classical baselines to compare the networks with, each tuned on the validation set, and an upper bound.

The tuned baselines keep a pixel free for some steps after a beam has passed over it. Otherwise a disc around an old hit
covers pixels that later scans observed to be free. `tune` chooses the number of steps.

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
from scipy.ndimage import distance_transform_edt, grey_dilation
from torch import Tensor

from repro.baselines.inference import infer
from repro.baselines.occupancy_grids import log_odds_grid, transitional_grid
from repro.baselines.privileged import Knowledge, privileged
from repro.baselines.tracker import draw, track
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_passed
from repro.metrics.scores import confusion, scores
from repro.recordings.recorded import Recorded
from repro.system.errors import InputError

Settings = dict[str, Any]
Baseline = Callable[[Recorded, Recorded], tuple[Tensor, Settings]]
RADII = tuple(0.01 * number for number in range(11))  # around hits, as shares of the side of the map
FREE = tuple(0.1 * number for number in range(11))  # how long a pixel stays free after a beam, as a share of T


def all_free(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict free space everywhere."""
    return torch.ones(test.maps.shape), {}


def mean_map(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict the mean of the validation maps, independent of the scans."""
    return val.maps.float().mean(dim=0, keepdim=True).expand(test.maps.shape), {}


def last_seen(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict an obstacle within a radius of every hit."""
    distances = {id(each): _distance_to_hits(each) for each in (val, test)}  # [px]
    radii_px = range(1 + int(RADII[-1] * val.grid.size_px))
    return tune(lambda each, radius_px: (distances[id(each)] > radius_px).float(), {"radius_px": radii_px}, val, test)


def occupancy(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict with a log-odds occupancy grid with forgetting; see `occupancy_grids.log_odds_grid`."""
    settings = {"forgetting": (0.0, 0.005, 0.02, 0.05), "radius_m": _radii_m(val)}
    return tune(_dilated(log_odds_grid, "forgetting"), settings, val, test)


def transitional(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict with a grid of static and dynamic occupancy; see `occupancy_grids.transitional_grid`."""
    settings = {"moving": (0.02, 0.1, 0.3), "radius_m": _radii_m(val)}
    return tune(_dilated(transitional_grid, "moving"), settings, val, test)


def tracker(val: Recorded, test: Recorded) -> tuple[Tensor, Settings]:
    """Predict by tracking clusters of hits; see `tracker.track`."""
    tracks: dict[tuple[int, float], Any] = {}

    def predict(each: Recorded, depth_m: float, radius_m: float) -> Tensor:
        key = (id(each), depth_m)
        if key not in tracks:
            tracks[key] = track(each, depth_m)
        return draw(tracks[key], each.grid, radius_m)

    return tune(predict, {"depth_m": (1.0, 2.0, 3.0), "radius_m": _radii_m(val)[2:]}, val, test)


PREDICTORS: dict[str, Baseline] = {
    "all_free": all_free,
    "mean_map": mean_map,
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

    Every prediction is combined with several `free_steps`: a pixel is free if a beam has passed over it fewer steps ago
    than that, and later than the last hit in it.

    Args:
        predict: function from recordings and settings to the probability of free, (M, 1, H, W).
        settings: the candidate values of each setting.
        val: the validation recordings.
        test: the test recordings.

    Returns:
        the probability of free of the test recordings, (M, 1, H, W), and the chosen settings.

    Raises:
        ValueError: `predict` returns another shape.
    """
    since, steps = steps_since_free(val), val.scans.ranges.shape[1]
    scored: list[tuple[float, Settings, int]] = []
    for values in itertools.product(*settings.values()):
        chosen = dict(zip(settings, values, strict=True))
        free = predict(val, **chosen)
        if free.shape != val.maps.shape:
            expected, got = tuple(val.maps.shape), tuple(free.shape)
            raise InputError(f"expected probabilities of free, {expected} as the maps, got {got}")
        for free_steps in (round(share * steps) for share in FREE):
            scored.append((_obstacle_iou(free.masked_fill(since < free_steps, 1.0), val), chosen, free_steps))
    _, chosen, free_steps = max(scored, key=lambda each: each[0])
    free = predict(test, **chosen).masked_fill(steps_since_free(test) < free_steps, 1.0)
    return free, {**chosen, "free_steps": free_steps}


def steps_since_free(recorded: Recorded) -> Tensor:
    """Return the steps since a beam last passed over each pixel, (M, 1, H, W).

    The last step of a window was 0 steps ago. Pixels that no beam passed over after their last hit have T.
    """
    scans, grid = recorded.scans, recorded.grid
    steps = scans.ranges.shape[1]
    passed = newest_passed(scans, grid, recorded.range_max_m).long()
    return torch.where(passed > newest_hits(scans, grid), steps - passed, steps)[:, None]


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


def _distance_to_hits(recorded: Recorded) -> Tensor:
    """Return the distance of each pixel to the nearest hit [px], infinite without hits, (M, 1, H, W)."""
    hits = (newest_hits(recorded.scans, recorded.grid) > 0).numpy()
    each = [distance_transform_edt(~hit) if hit.any() else np.full(hit.shape, np.inf) for hit in hits]
    return torch.from_numpy(np.stack(each))[:, None]


def _radii_m(recorded: Recorded) -> tuple[float, ...]:
    return tuple(share * recorded.grid.size_m for share in RADII)


def _dilated(grid_filter: Callable[[Recorded, float], Tensor], setting: str) -> Callable[..., Tensor]:
    """Return a predictor that filters a grid, once per value of `setting`, and dilates its occupancy by a radius."""
    occupancies: dict[tuple[int, float], Tensor] = {}

    def predict(each: Recorded, radius_m: float, **settings: float) -> Tensor:
        key = (id(each), settings[setting])
        if key not in occupancies:
            occupancies[key] = grid_filter(each, settings[setting])
        return dilate(occupancies[key], int(np.rint(radius_m / each.grid.resolution_m)))

    return predict
