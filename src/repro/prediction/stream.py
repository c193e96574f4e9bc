"""Maps from scans as they arrive: the window of each scan, as `windows.cut` makes it, in constant memory."""

import copy
import logging
import math
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from repro.logs.consistency import MIN_PATH_M, inconsistencies, note_on_rare
from repro.logs.log_scan import LogScan
from repro.logs.misses import MissCheck
from repro.logs.options import window_of
from repro.logs.poses import MAX_PLACE_M
from repro.logs.readings import beams_of_turn, check_heading, check_stamp, is_in_meters, readings
from repro.logs.reasons import Reason
from repro.logs.scan_log import ScanLog, path_m
from repro.logs.times import Clock, parts_of, steps_before
from repro.maps.statistics import TITLES
from repro.maps.validity import check_angles
from repro.maps.visibility import beam_spacing
from repro.networks.predictor import Predictor
from repro.prediction.moving import MOVERS
from repro.prediction.stream_map import StreamMap, predict_map
from repro.prediction.windows import on_map
from repro.system.arrays import real
from repro.system.errors import InputError
from repro.system.threads import OneAtATime

LOGGER = logging.getLogger(__name__)
CHECKS = 3  # of scans and poses, whose conventions do not change
EXTRA = 6  # scans: the one before the window, one with a wrong time, and those of the tolerance of half a step


def log_warning(text: str) -> None:
    """Log a warning of a stream."""
    LOGGER.warning("%s", text)


class PredictionStream:
    """Predicts a map for every scan from the window that ends with it.

        stream = PredictionStream(predictor, angles)
        predicted = stream.update(ranges, pose, stamp)  # None until the scans fill a window

    `update` is `add` and `predict`, which are called alone where scans arrive more often than maps are needed.
    The rules are those of a log, see `times.Clock` and `times.steps_before`; the map equals that of
    `Predictor.predict` for the same window, bit by bit. As many scans are kept as a window can have, so memory is
    constant. Several threads may update a stream: one waits for another, and the order is theirs.

    A stream checks after some windows whether scans and poses fit together, see `consistency`.

    Args:
        predictor: network, encoding and grid.
        angles: beam angles [rad], (N,), increasing and evenly spaced, within one turn. The last beams of a full turn
            that point where the first ones do are left out, as in a log.
        center: center of the map: `robot` (the newest pose), or x, y in the frame of the poses [m].
        steps: steps of a window, T; None for those of the training.
        step_s: time of a step [s]; None for that of the training.
        range_max_m: maximum range of the lidar [m], see `Predictor.with_range`; None if it is not known.
        misses: `free`, or `invalid` if lost beams arrive as misses, see `misses`.
        warn: is called once with each reason to doubt the maps.

    Attributes:
        reason: why the last update has no map; None if it has one.
        left_out: why its scan was left out; None if it was kept.
        inconsistencies: what has shown that scans, poses and times do not fit together, so that the maps are wrong.

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
        warn: Callable[[str], None] = log_warning,
    ) -> None:
        if not isinstance(predictor, Predictor):
            raise InputError(f"predictor: expected that of load_predictor, got {predictor!r}")
        if isinstance(center, str) and center != "robot":
            raise InputError(f"center: expected robot or x, y [m], got {center!r}")
        if not callable(warn):
            raise InputError(f"warn: expected a function of a text, got {warn!r}")
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
        self.warn, self._warned = warn, set[str]()
        self.inconsistencies: list[str] = []
        self._checks, self._checked_s = 0, math.nan  # how often scans and poses were compared, and when last
        self._lock = OneAtATime("update")

    def __copy__(self) -> "PredictionStream":
        """Return a stream with the same scans, which takes others from now on, and warns in the same way."""
        return self.__deepcopy__({})

    def __deepcopy__(self, memo: dict[int, Any]) -> "PredictionStream":
        other = object.__new__(type(self))
        other.__dict__ = copy.deepcopy(self.__dict__, memo | {id(self.warn): self.warn})
        return other

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
            return None if self.reason else self._predict()

    def add(self, ranges: np.ndarray, pose: np.ndarray, stamp: float) -> None:
        """Take a scan, see `update`, without predicting a map; `reason` has the cause if it was left out."""
        with self._lock:
            self._take(*self._checked(ranges, pose), stamp)

    def predict(self) -> StreamMap | None:
        """Predict the map at the time of the newest scan that was kept; None if there is no window, see `update`."""
        with self._lock:
            return self._predict()

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
        self._warn_once(self._misses.add(np.asarray(raw), ranges, float(pose[2]), self.range_max_m))
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
            self.reason = note_on_rare(np.array(stamps), self.settings) or str(error)
            return None
        origin = self.settings.origin(poses[-1], poses[-1], self.predictor.grid.size_m)
        window = on_map(np.stack([ranges[i] for i in index]), self.angles, np.stack([poses[i] for i in index]), origin)
        place = float(origin[0]), float(origin[1])
        predicted = predict_map(self.predictor, window, place, stamps[-1], self.range_max_m)
        self._warn_of(predicted)
        return predicted

    def _compare(self, stamp: float) -> None:
        """Compare the kept scans with their poses at the end of a few windows in which the robot has driven."""
        since_s = stamp - self._checked_s  # NaN at first
        if self._checks == CHECKS or self.inconsistencies or abs(since_s) < self.settings.duration_s:
            return
        self._checked_s = stamp
        stamps, ranges, poses = map(np.array, zip(*self._kept, strict=True))
        if since_s > 0 and path_m(poses) >= MIN_PATH_M:
            self._checks += 1
            self.inconsistencies = inconsistencies(ScanLog(stamps, ranges, self.angles, poses), self.settings)
            self._warn_once(filter(None, [*self.inconsistencies, note_on_rare(stamps, self.settings)]))

    def _warn_of(self, predicted: StreamMap) -> None:
        """Warn of what makes a map doubtful."""
        self._compare(predicted.stamp)
        if predicted.moving.any():
            self._warn_once([MOVERS])
        self._warn_once(f"outside of the training: {TITLES[name]}" for name in predicted.outside_training)

    def _warn_once(self, texts: Iterable[str]) -> None:
        for text in texts:
            if text not in self._warned:
                self._warned.add(text)
                self.warn(text)

    def _checked_pose(self, pose: Any) -> np.ndarray:
        """Return a copy of a pose in float64, which the caller may change afterwards."""
        pose = np.array(real("pose", pose, (3,)), dtype=float)
        if not np.isfinite(pose).all() or np.abs(pose[:2]).max() > MAX_PLACE_M:
            raise InputError(f"pose: expected a finite one within {MAX_PLACE_M:g} m, got {pose}")
        check_heading(float(pose[2]), "the headings look")
        return pose
