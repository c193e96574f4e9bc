"""Maps from scans as they arrive: the window of each scan, as `windows.cut` makes it, in constant memory."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import torch

from repro.maps.validity import check_angles
from repro.maps.visibility import beam_spacing
from repro.networks.predictor import Predictor
from repro.prediction.readings import beams_of_turn, check_heading, check_turn, readings
from repro.prediction.windows import longest_gap_s, on_map, steps_before
from repro.system.errors import InputError


@dataclass(frozen=True)
class StreamMap:
    """A predicted map.

    Args:
        free: probability of free, (H, W); row 0 is the top.
        origin: x, y of the lower left corner of the map in the frame of the poses [m].
        resolution_m: side of a pixel [m].
        stamp: time of the scan at the end of the window [s].
    """

    free: np.ndarray
    origin: tuple[float, float]
    resolution_m: float
    stamp: float


class PredictionStream:
    """Predicts a map for every scan from the window that ends with it.

    stream = PredictionStream(predictor, angles)
    predicted = stream.update(ranges, pose, stamp)  # None until the scans fill a window

    Each step of the window takes the scan nearest in time, as in `windows.cut`; the map equals that of
    `Predictor.predict` for the same window, bit by bit. Scans are kept for the duration of a window, so memory is
    constant. A scan that follows the last one by less than half a step is left out, as in the prediction of a log.

    The window is drawn anew for each map: the network takes most of the time, and a map that moves with the robot has
    no pixel in common with the one before.

    Args:
        predictor: network, encoding and grid.
        angles: beam angles [rad], (N,), increasing and evenly spaced, within one turn. The last beams of a full turn
            that point where the first ones do are left out, as in a log.
        center: center of the map: `robot` (the newest pose), or x, y in the frame of the poses [m].
        steps: steps of a window, T; None for those of the training.
        step_s: time of a step [s]; None for that of the training.
        range_max_m: maximum range of the lidar [m], see `Predictor.with_range`; None if it is not known.

    Raises:
        ValueError: an argument has another shape or value, or the network needs a fixed center.
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
    ) -> None:
        self.range_max_m = math.inf if range_max_m is None else range_max_m
        self.predictor, self.angles = predictor.with_range(self.range_max_m), np.array(angles, dtype=float)
        self.steps, self.step_s = predictor.window(steps, step_s)
        if self.angles.ndim != 1 or not len(self.angles) or not np.isfinite(self.angles).all():
            raise InputError(f"angles: expected N finite angles [rad], got an array of shape {self.angles.shape}")
        check_angles(torch.as_tensor(self.angles))
        self.beams, spacing = len(self.angles), beam_spacing(torch.as_tensor(self.angles))
        check_turn(self.beams, self.angles[0], spacing, "angles")
        self.angles = self.angles[: beams_of_turn(self.angles)]
        self.center = center_point(predictor, center)
        self.reason: str | None = None
        self._kept: deque[tuple[float, np.ndarray, np.ndarray]] = deque()

    def __len__(self) -> int:
        """Return the number of scans in memory."""
        return len(self._kept)

    def limit(self, range_max_m: float) -> None:
        """Let all misses show free space up to a smaller maximum range only [m], see `Predictor.with_range`."""
        self.predictor = self.predictor.with_range(range_max_m)

    def update(self, ranges: np.ndarray, pose: np.ndarray, stamp: float) -> StreamMap | None:
        """Take a scan and predict the map at its time.

        A scan that is not later than the last one is left out. If it is earlier by more than a window, the clock was
        set back, and the stream begins again with it.

        Args:
            ranges: ranges [m], (N,); from `range_max_m` on a miss; negative, zero and NaN are invalid.
            pose: x, y [m] and heading [rad] of the lidar, (3,).
            stamp: time of the scan [s].

        Returns:
            the map; None while the scans do not fill a window, after a gap in it, or if the scan was left out, and then
            `reason` says which.

        Raises:
            ValueError: the scan cannot be one of this lidar, and is left out; or its window cannot be predicted, see
                `Predictor.predict`.
        """
        ranges, pose = self._checked(ranges, pose, stamp)
        self.reason = self._add(float(stamp), ranges, pose)
        if self.reason:
            return None
        stamps = np.array([kept[0] for kept in self._kept])
        try:
            index = steps_before(stamps, stamp, steps=self.steps, step_s=self.step_s)
        except InputError as error:
            self.reason = str(error)
            return None
        grid = self.predictor.grid
        origin = (pose[:2] if self.center is None else self.center) - grid.size_m / 2
        window_ranges, window_poses = (np.stack([self._kept[i][part] for i in index]) for part in (1, 2))
        window = on_map(window_ranges, self.angles, window_poses, origin)
        free = self.predictor.predict(window)[0].numpy()
        return StreamMap(free, (float(origin[0]), float(origin[1])), grid.resolution_m, float(stamp))

    def _add(self, stamp: float, ranges: np.ndarray, pose: np.ndarray) -> str | None:
        """Keep a scan and forget those that no later window needs; return why it is left out, None if it is not."""
        duration = (self.steps - 1) * self.step_s
        if self._kept:
            since = stamp - self._kept[-1][0]
            if since < -max(duration, self.step_s) or since > longest_gap_s(self.step_s):
                self._kept.clear()  # the clock was set back, or a gap divides the scans as it divides a log
            elif since <= 0:
                return f"the scan at {stamp:.2f} s is not later than the one before"
            elif since < self.step_s / 2:
                return f"the scan at {stamp:.2f} s follows the one before by less than half a step"
        self._kept.append((stamp, ranges, pose))
        while len(self._kept) > 1 and self._kept[1][0] <= stamp - duration:
            self._kept.popleft()
        return None

    def _checked(self, ranges: np.ndarray, pose: np.ndarray, stamp: float) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of the ranges in float32 and of the pose in float64, which the caller may change afterwards."""
        ranges, pose = readings(ranges, 0.0, self.range_max_m), np.array(pose, dtype=float)
        if ranges.shape != (self.beams,) or pose.shape != (3,):
            raise InputError(f"expected ranges ({self.beams},) and a pose (3,), got {ranges.shape} and {pose.shape}")
        ranges = ranges[: len(self.angles)]
        if np.isnan(ranges).all():
            raise InputError("ranges: no valid reading: expected meters, inf for a miss, NaN for an invalid reading")
        if not np.isfinite(pose).all() or not math.isfinite(stamp):
            raise InputError(f"expected a finite pose and time, got {pose} at {stamp} s")
        check_heading(float(pose[2]), "the headings look")
        return ranges, pose


def center_point(predictor: Predictor, center: str | tuple[float, float]) -> np.ndarray | None:
    """Return the center of a map as x, y [m], (2,); None for `robot`.

    Raises:
        ValueError: it is neither, or the network needs a fixed center.
    """
    predictor.check_center(center)
    if isinstance(center, str) and center == "robot":
        return None
    try:
        point = np.array(center, dtype=float)
    except (TypeError, ValueError):
        point = np.array(math.nan)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise InputError(f"center: expected robot or x, y [m], got {center!r}")
    return point
