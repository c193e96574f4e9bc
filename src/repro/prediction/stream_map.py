"""The predicted map of one window of scans."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from repro.maps.series import Series
from repro.maps.statistics import measure
from repro.networks.predictor import Predictor
from repro.prediction.moving import moving_pixels, parts_of_window, stands
from repro.scans import Scans
from repro.system.arrays import real
from repro.system.errors import InputError

REACH_M = Series.range_max_m  # up to which a miss shows free space, where the network has no such limit


@dataclass(frozen=True, eq=False, repr=False)
class StreamMap:
    """A predicted map.

    Args:
        free: probability of free, (H, W); row 0 is the top.
        origin: x, y of the lower left corner of the map in the frame of the poses [m].
        resolution_m: side of a pixel [m].
        stamp: time of the scan at the end of the window [s].
        unknown: pixels that no reading supports: no beam of the window has hit or passed over them, bool, (H, W).
        moving: pixels of hits in the window on something that moves, bool, (H, W), see `moving`; what moves is missing
            from the map where it is after it has left the view.
        hits: x, y of the hits of the scan at the end of the window in the frame of the poses [m], (K, 2).
        pose: x, y [m] and heading [rad] of the lidar at the end of the window.
        statistics: of the scans of the window by name, see `maps.statistics.TITLES`.
        outside_training: the names of those that no window of the training had; the map may be wrong.
    """

    free: np.ndarray
    origin: tuple[float, float]
    resolution_m: float
    stamp: float
    unknown: np.ndarray
    moving: np.ndarray
    hits: np.ndarray
    pose: tuple[float, float, float]
    statistics: Mapping[str, float] = field(default_factory=dict)
    outside_training: tuple[str, ...] = ()

    def __repr__(self) -> str:
        (height, width), (x, y) = self.free.shape, self.origin
        size = f"{height} x {width} px of {self.resolution_m:.3g} m"
        return f"StreamMap({size} from ({x:.2f}, {y:.2f}) at {self.stamp:.2f} s)"


def predict_map(
    predictor: Predictor, window: Scans, origin: tuple[float, float], stamp: float, range_max_m: float = math.inf
) -> StreamMap:
    """Predict the map of one window, whose poses are on the map.

    Args:
        predictor: network, encoding and grid.
        window: ranges (T, N), angles (N,), poses (T, 3).
        origin: x, y of the lower left corner of the map [m].
        stamp: time of the last step [s].
        range_max_m: maximum range of the lidar [m], up to which a miss shows free space, as far as in the training.

    Raises:
        InputError: the window cannot be predicted, see `Predictor.predict`.
    """
    place = real("origin", origin, (2,)).astype(float)
    if not np.isfinite(place).all() or not np.isfinite(real("stamp", stamp, ())):
        raise InputError(f"expected a finite origin x, y [m] and time [s], got {origin} and {stamp}")
    predictor = predictor.with_range(range_max_m)
    free = predictor.predict(window)[0]
    hits, passed = parts_of_window(window, predictor.grid, min(range_max_m, predictor.reach_m or REACH_M))
    unknown, moving = ~(hits | passed).any(0), moving_pixels(hits, passed, is_still=stands(window.poses))
    points, is_hit = Scans(window.ranges[-1:], window.angles, window.poses[-1:]).points()
    left, bottom, (x, y, heading) = *map(float, place), map(float, window.poses[-1])
    statistics = {name: float(value[0]) for name, value in measure(window.batched(), predictor.grid).items()}
    return StreamMap(
        free,
        (left, bottom),
        predictor.grid.resolution_m,
        stamp,
        unknown,
        moving,
        points[is_hit] + place,
        (left + x, bottom + y, heading),
        statistics,
        tuple(predictor.statistics.outside(statistics)) if predictor.statistics else (),
    )
