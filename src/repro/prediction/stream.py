"""Maps from scans as they arrive: the window of each scan, as `windows.cut` makes it, in constant memory."""

import copy
import logging
import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from repro.logs.log_scan import LogScan
from repro.logs.misses import MissCheck
from repro.logs.options import window_of
from repro.logs.poses import MAX_PLACE_M
from repro.logs.readings import beams_of_turn, check_heading, check_stamp, is_in_meters, readings
from repro.logs.reasons import Reason
from repro.logs.times import Clock, parts_of, steps_before
from repro.maps.series import Series
from repro.maps.validity import check_angles
from repro.maps.visibility import beam_spacing
from repro.networks.predictor import Predictor
from repro.prediction.moving import MOVERS, moving_pixels, parts_of_window, stands
from repro.prediction.windows import on_map
from repro.scans import Scans
from repro.system.arrays import real
from repro.system.errors import InputError
from repro.system.threads import OneAtATime

LOGGER = logging.getLogger(__name__)
REACH_M = Series.range_max_m  # up to which a miss shows free space, where the network has no such limit
EXTRA = 6  # scans: the one before the window, one with a wrong time, and those of the tolerance of half a step


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
    """

    free: np.ndarray
    origin: tuple[float, float]
    resolution_m: float
    stamp: float
    unknown: np.ndarray
    moving: np.ndarray
    hits: np.ndarray
    pose: tuple[float, float, float]

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
    pose, resolution_m = (left + x, bottom + y, heading), predictor.grid.resolution_m
    return StreamMap(free, (left, bottom), resolution_m, stamp, unknown, moving, points[is_hit] + place, pose)


class PredictionStream:
    """Predicts a map for every scan from the window that ends with it.

        stream = PredictionStream(predictor, angles)
        predicted = stream.update(ranges, pose, stamp)  # None until the scans fill a window

    `update` is `add` and `predict`, which are called alone where scans arrive more often than maps are needed.
    The rules are those of a log, see `times.Clock` and `times.steps_before`; the map equals that of
    `Predictor.predict` for the same window, bit by bit. As many scans are kept as a window can have, so memory is
    constant. Several threads may update a stream: one waits for another, and the order is theirs.

    Args:
        predictor: network, encoding and grid.
        angles: beam angles [rad], (N,), increasing and evenly spaced, within one turn. The last beams of a full turn
            that point where the first ones do are left out, as in a log.
        center: center of the map: `robot` (the newest pose), or x, y in the frame of the poses [m].
        steps: steps of a window, T; None for those of the training.
        step_s: time of a step [s]; None for that of the training.
        range_max_m: maximum range of the lidar [m], see `Predictor.with_range`; None if it is not known.
        misses: `free`, or `invalid` if lost beams arrive as misses, see `misses`.

    Attributes:
        reason: why the last update has no map; None if it has one.
        left_out: why its scan was left out; None if it was kept.

    Raises:
        InputError: an argument has another shape or value, or the network needs a fixed center.
    """

    def __init__(
        self,
        predictor: Predictor,
        angles: np.ndarray,
        *,
        center: str | tuple[float, float] = "robot",
        steps: int | None = None,
        step_s: float | None = None,
        range_max_m: float | None = None,
        misses: str = "free",
    ) -> None:
        if not isinstance(predictor, Predictor):
            raise InputError(f"predictor: expected that of load_predictor, got {predictor!r}")
        if isinstance(center, str) and center != "robot":
            raise InputError(f"center: expected robot or x, y [m], got {center!r}")
        known_m = None if range_max_m == math.inf else range_max_m
        self.settings = window_of(predictor, steps, step_s, center=center, range_max_m=known_m, misses=misses)
        self.range_max_m = self.settings.range_max_m or math.inf
        self.predictor, self.angles = predictor, real("angles", angles).astype(float)
        if self.angles.ndim != 1 or not len(self.angles) or not np.isfinite(self.angles).all():
            raise InputError(f"angles: expected N finite angles [rad], got an array of shape {self.angles.shape}")
        check_angles(self.angles)
        beam_spacing(self.angles)  # refuses beams that are not evenly spaced
        self.beams = len(self.angles)
        self.angles = self.angles[: beams_of_turn(self.angles)]
        self.reason: str | None = None
        self.left_out: Reason | None = None
        most = 2 * self.settings.steps + EXTRA  # kept scans are half a step apart or more
        self._kept: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=most)
        self._clock, self._misses = Clock(self.settings), MissCheck()
        self._has_movers = False  # of which it is said once
        self._lock = OneAtATime("update")

    __copy__ = copy.deepcopy  # a stream with the same scans, which takes others from now on

    def __repr__(self) -> str:
        return f"PredictionStream({self.predictor!r}, {self.beams} beams, {len(self._kept)} scans)"

    def update(self, ranges: np.ndarray, pose: np.ndarray, stamp: float) -> StreamMap | None:
        """Take a scan and predict the map at its time.

        Args:
            ranges: ranges [m], (N,); from `range_max_m` on a miss; negative, zero and NaN are invalid.
            pose: x, y [m] and heading [rad] of the lidar, (3,).
            stamp: time of the scan [s].

        Returns:
            the map; None while the scans do not fill a window, after a gap, or if the scan was left out, and then
            `reason` says which.

        Raises:
            InputError: the scan cannot be one of this lidar, and is left out; or its window cannot be predicted, see
                `Predictor.predict`.
        """
        with self._lock:
            self._take(*self._checked(ranges, pose), stamp)
            return self._with_warning(None if self.reason else self._predict())

    def add(self, ranges: np.ndarray, pose: np.ndarray, stamp: float) -> None:
        """Take a scan, see `update`, without predicting a map; `reason` has the cause if it was left out."""
        with self._lock:
            self._take(*self._checked(ranges, pose), stamp)

    def predict(self) -> StreamMap | None:
        """Predict the map at the time of the newest scan that was kept; None if there is no window, see `update`."""
        with self._lock:
            return self._with_warning(self._predict())

    def _with_warning(self, predicted: StreamMap | None) -> StreamMap | None:
        """Return a map, and say once that something moves."""
        if predicted is not None and predicted.moving.any() and not self._has_movers:
            self._has_movers = True
            LOGGER.warning("%s (%.2f s)", MOVERS, predicted.stamp)
        return predicted

    def _checked(self, raw: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of the ranges in float32 and of the pose in float64, and warn of misses that are none."""
        pose = self._checked_pose(pose)
        ranges = readings(raw, 0.0, self.range_max_m, self.settings.misses)
        if ranges.shape != (self.beams,):
            raise InputError(f"ranges: expected the shape ({self.beams},), got {ranges.shape}")
        if not is_in_meters(np.asarray(raw)):
            raise InputError("ranges: expected meters, inf for a miss, and most of these are beyond 300")
        if np.isnan(ranges).all():
            raise InputError("ranges: no valid reading: expected meters, inf for a miss, NaN for an invalid reading")
        for note in self._misses.add(np.asarray(raw), ranges, float(pose[2]), self.range_max_m):
            LOGGER.warning("%s", note)
        return ranges[: len(self.angles)], pose

    def extend(self, scan: LogScan) -> StreamMap | None:
        """Take a scan from a `ScanFilter`, whose beams are those of the stream, and predict the map at its time."""
        with self._lock:
            self._take(scan.ranges, self._checked_pose(scan.pose), scan.stamp)
            return None if self.reason else self._predict()

    def _take(self, ranges: np.ndarray, pose: np.ndarray, stamp: float) -> None:
        """Keep a scan, or state in `reason` why it is left out."""
        stamp = check_stamp(stamp, self.settings.step_s)
        self.left_out = self._clock.why_left_out(stamp)
        self.reason = self.left_out and f"the scan at {stamp:.2f} s is {self.left_out}"
        if self.left_out:
            return
        if self._clock.replaces:
            self._kept.pop()
        self._kept.append((stamp, ranges, pose))

    def _predict(self) -> StreamMap | None:
        """Predict the map of the window that ends with the newest scan that was kept."""
        if not self._kept:
            return None
        stamps, ranges, poses = zip(*self._kept, strict=True)
        begin, _ = parts_of(np.array(stamps), self.settings)[-1]
        try:
            index = begin + steps_before(np.array(stamps[begin:]), self.settings)
        except InputError as error:
            self.reason = str(error)
            return None
        origin = self.settings.origin(poses[-1], poses[-1], self.predictor.grid.size_m)
        window = on_map(np.stack([ranges[i] for i in index]), self.angles, np.stack([poses[i] for i in index]), origin)
        return predict_map(self.predictor, window, (float(origin[0]), float(origin[1])), stamps[-1], self.range_max_m)

    def _checked_pose(self, pose: Any) -> np.ndarray:
        """Return a copy of a pose in float64, which the caller may change afterwards."""
        pose = np.array(real("pose", pose, (3,)), dtype=float)
        if not np.isfinite(pose).all() or np.abs(pose[:2]).max() > MAX_PLACE_M:
            raise InputError(f"pose: expected a finite one within {MAX_PLACE_M:g} m, got {pose}")
        check_heading(float(pose[2]), "the headings look")
        return pose
