"""Classical baselines to compare the networks with, each tuned on the validation set.

The tuned baselines keep a pixel free for some steps after a beam has passed over it. Otherwise a disc around an old hit
covers pixels that later scans observed to be free. `tune` chooses the number of steps.

A baseline maps the validation and the test recordings to the probability of free of the test recordings,
(M, 1, H, W), and the tuned settings. A new baseline needs a function here, an entry in `PREDICTORS` and its title in
`baselines.titles`.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, grey_dilation

from repro.baselines.occupancy_grids import log_odds_grid, transitional_grid
from repro.baselines.tracker import Prior, clusters, distances, track
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_passed
from repro.metrics.scores import THRESHOLD
from repro.recordings.recorded import Recorded
from repro.system.errors import InputError
from repro.system.progress import progress
from repro.worlds.spec import WorldSpec

Settings = dict[str, Any]
Baseline = Callable[[Recorded, Recorded], tuple[np.ndarray, Settings]]
Predict = Callable[..., np.ndarray]
RADII = tuple(0.01 * number for number in range(11))  # around hits, as shares of the side of the map
FREE = tuple(0.1 * number for number in range(11))  # how long a pixel stays free after a beam, as a share of T
TRACKER = {  # searched one after another; 1000 stands for no limit, a speed of 0.001 m/s for none
    "near_m": (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0),
    "radius_m": (2.25, 2.4, 2.55, 2.7, 2.85, 3.0, 3.15, 3.3),
    "spread_m": (0.05, 0.1, 0.2, 0.3, 0.4, 0.55, 1.0, 2.0, 1000.0),
    "speed_m_s": (0.001, 0.1, 0.2, 0.4, 0.6, 1.0),
    "aspect": (1.1, 1.25, 1.4, 1.6, 1.8),
    "join": (0.0, 1.0, 2.0, 5.0, 10.0, 50.0, 1000.0),
    "coast_s": (0.0, 2.0, 4.0, 5.0, 6.0, 8.0, 10.0),
    "margin_m": (-0.6, -0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4, 0.6),
}


def all_free(val: Recorded, test: Recorded) -> tuple[np.ndarray, Settings]:
    """Predict free space everywhere."""
    return np.ones(test.maps.shape, np.float32), {}


def mean_map(val: Recorded, test: Recorded) -> tuple[np.ndarray, Settings]:
    """Predict the mean of the validation maps, independent of the scans."""
    return np.broadcast_to(val.maps.mean(axis=0, dtype=np.float32, keepdims=True), test.maps.shape), {}


def last_seen(val: Recorded, test: Recorded) -> tuple[np.ndarray, Settings]:
    """Predict an obstacle within a radius of every hit."""

    def prepare(recorded: Recorded) -> Predict:
        distance = _distance_to_hits(recorded)  # [px]
        return lambda radius_px: (distance > radius_px).astype(np.float32)

    return tune(prepare, {"radius_px": range(1 + int(RADII[-1] * val.grid.size_px))}, val, test)


def occupancy(val: Recorded, test: Recorded) -> tuple[np.ndarray, Settings]:
    """Predict with a log-odds occupancy grid with forgetting; see `occupancy_grids.log_odds_grid`."""
    settings = {"forgetting": (0.0, 0.005, 0.02, 0.05), "radius_m": _radii_m(val)}
    return tune(partial(_dilated, log_odds_grid, "forgetting"), settings, val, test)


def transitional(val: Recorded, test: Recorded) -> tuple[np.ndarray, Settings]:
    """Predict with a grid of static and dynamic occupancy; see `occupancy_grids.transitional_grid`."""
    settings = {"moving": (0.0, 0.005, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0), "radius_m": _radii_m(val)}
    return tune(partial(_dilated, transitional_grid, "moving"), settings, val, test, climbs=True)


def tracker(val: Recorded, test: Recorded) -> tuple[np.ndarray, Settings]:
    """Predict by tracking discs and rectangles; see `tracker.track`."""

    def prepare(recorded: Recorded) -> Predict:
        scans = [recorded.scans[index] for index in range(len(recorded))]
        found = cache(lambda near_m: [clusters(window, recorded.step_s, near_m) for window in scans])
        tracks = cache(lambda near_m, prior: [track(close, prior) for close in found(near_m)])

        @lru_cache(maxsize=4)  # an array of all recordings takes much memory
        def nearest(near_m: float, coast_s: float, prior: Prior) -> np.ndarray:
            return np.stack([distances(own, recorded.grid, coast_s) for own in tracks(near_m, prior)])

        def predict(near_m: float, coast_s: float, margin_m: float, **prior: float) -> np.ndarray:
            return (nearest(near_m, coast_s, Prior(**prior)) > margin_m).astype(np.float32)[:, None]

        return predict

    return tune(prepare, TRACKER, val, test, climbs=True)


PREDICTORS: dict[str, Baseline] = {
    "all_free": all_free,
    "mean_map": mean_map,
    "last_seen": last_seen,
    "occupancy": occupancy,
    "transitional": transitional,
    "tracker": tracker,
}


def applies(name: str, spec: WorldSpec) -> bool:
    """Return whether a baseline adds something in worlds of a spec."""
    return name != "mean_map" or bool(spec.fixed)  # it predicts the fixed obstacles


def tune(
    prepare: Callable[[Recorded], Predict],
    settings: Mapping[str, Sequence[float]],
    val: Recorded,
    test: Recorded,
    *,
    climbs: bool = False,
) -> tuple[np.ndarray, Settings]:
    """Predict the test set with the settings that have the best obstacle IoU on the validation set.

    Every prediction is combined with several `free_steps`: a pixel is free if a beam has passed over it fewer steps ago
    than that, and later than the last hit in it.

    Args:
        prepare: function from recordings to a function from settings to their probability of free, (M, 1, H, W).
        settings: the candidate values of each setting, in ascending order.
        climbs: False tries all combinations; True starts from the middle values and moves one setting after another to
            the next value as long as the IoU rises.

    Returns:
        the probability of free of the test recordings, (M, 1, H, W), and the chosen settings.

    Raises:
        InputError: `prepare` leads to another shape.
    """
    predict, occupied = prepare(val), val.maps == 0
    since, steps = steps_since_free(val), val.scans.ranges.shape[1]
    kept = {number: since >= number for number in (round(share * steps) for share in FREE)}

    lengths = [len(values) for values in settings.values()]
    tried = progress(
        description=f"tuning {', '.join(settings)}", total=sum(lengths) if climbs else math.prod(lengths)
    )  # climbing: about

    @cache
    def score(*values: float) -> tuple[float, int]:
        tried.update()
        free = predict(**dict(zip(settings, values, strict=True)))
        if free.shape != val.maps.shape:
            raise InputError(f"expected probabilities of free, {val.maps.shape} as the maps, got {free.shape}")
        found = free < THRESHOLD
        scores = ((_iou(found & mask, occupied), number) for number, mask in kept.items())
        return max(scores, key=lambda scored: scored[0])

    if climbs:
        best = climb(lambda values: score(*values)[0], list(settings.values()))
    else:
        best = max(itertools.product(*settings.values()), key=lambda values: score(*values)[0])
    tried.close()
    chosen, free_steps = dict(zip(settings, best, strict=True)), score(*best)[1]
    free = np.where(steps_since_free(test) < free_steps, np.float32(1), prepare(test)(**chosen))
    return free, {**chosen, "free_steps": free_steps}


def climb(score: Callable[[tuple[float, ...]], float], candidates: list[Sequence[float]]) -> tuple[float, ...]:
    """Return values, one of each list of candidates, from which no step of a single one raises the score.

    Args:
        score: what is climbed.
        candidates: the values of each setting, in ascending order; the middle ones are the start.
    """
    best, before = tuple(values[len(values) // 2] for values in candidates), None
    while best != before:
        before = best
        for which, values in enumerate(candidates):
            for step in (1, -1):
                while 0 <= (place := values.index(best[which]) + step) < len(values):
                    moved = (*best[:which], values[place], *best[which + 1 :])
                    if score(moved) <= score(best):
                        break
                    best = moved
    return best


def _iou(found: np.ndarray, occupied: np.ndarray) -> float:
    union = np.count_nonzero(found | occupied)
    return float(np.count_nonzero(found & occupied) / union) if union else 0.0


def steps_since_free(recorded: Recorded) -> np.ndarray:
    """Return the steps since a beam last passed over each pixel, (M, 1, H, W).

    The last step of a window was 0 steps ago. Pixels that no beam passed over after their last hit have T.
    """
    scans, grid = recorded.scans, recorded.grid
    steps = scans.ranges.shape[1]
    passed = newest_passed(scans, grid, recorded.range_max_m)
    return np.where(passed > newest_hits(scans, grid), steps - passed, steps)[:, None]


def dilate(occupied: np.ndarray, radius_px: int) -> np.ndarray:
    """Dilate occupancy by a disc.

    Args:
        occupied: probability of an obstacle, (M, H, W).
        radius_px: radius of the disc [px].

    Returns:
        probability of free, (M, 1, H, W): one minus the highest occupancy within the radius.
    """
    reach = np.arange(-radius_px, radius_px + 1)
    disc = np.square(reach[:, None]) + np.square(reach) <= radius_px**2
    dilated = grey_dilation(occupied.astype(np.float32), footprint=disc[None], mode="constant", cval=0.0)
    return 1 - dilated[:, None]


def _distance_to_hits(recorded: Recorded) -> np.ndarray:
    """Return the distance of each pixel to the nearest hit [px], infinite without hits, (M, 1, H, W)."""
    hits = newest_hits(recorded.scans, recorded.grid) > 0
    away = [distance_transform_edt(~hit) if hit.any() else np.full(hit.shape, np.inf) for hit in hits]
    return np.stack(away)[:, None]


def _radii_m(recorded: Recorded) -> tuple[float, ...]:
    return tuple(share * recorded.grid.size_m for share in RADII)


def _dilated(grid_filter: Callable[[Recorded, float], np.ndarray], setting: str, recorded: Recorded) -> Predict:
    """Return a predictor that filters a grid, once per value of `setting`, and dilates its occupancy by a radius."""
    occupancy = cache(partial(grid_filter, recorded))

    def predict(radius_m: float, **settings: float) -> np.ndarray:
        return dilate(occupancy(settings[setting]), int(np.rint(radius_m / recorded.grid.resolution_m)))

    return predict
