"""Maps from ROS messages as they arrive: the same for every version of ROS, which has its node in examples/."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from repro.networks.predictor import Predictor
from repro.prediction.readings import (
    WITHOUT_POSE,
    LogScan,
    check_beams,
    has_same_beams,
    has_valid_range,
    in_order,
    note_on_range,
    valid_ranges,
    why_unusable,
)
from repro.prediction.ros import add_odometry, add_transforms, log_scan, middle_of, seconds
from repro.prediction.stream import PredictionStream, StreamMap, center_point
from repro.prediction.transforms import MAX_GAP_S, Transforms, without_transform
from repro.system.errors import InputError

KEEP_S = 30.0  # age up to which poses are remembered
MAX_WAITING = 50  # scans that wait for their poses or for the network
MOST_OTHERS = 10  # scans in a row with other beams than the first, after which the window begins again


def two_numbers(text: str) -> tuple[float, float] | None:
    """Read a parameter of two numbers, `x,y`; None for an empty one.

    Raises:
        ValueError: it is neither.
    """
    try:
        numbers = tuple(float(word) for word in text.split(",")) if text else None
    except ValueError:
        numbers = ()
    if numbers is None or len(numbers) == 2:
        return numbers
    raise InputError(f"expected two numbers, x,y, got {text!r}")


class LiveMapper:
    """Predicts a map for every scan, once poses before and after it are known.

    A scan waits until its pose can be interpolated, as in the prediction from a bag, at most `MAX_GAP_S`. The methods
    may be called from several threads.

    Args:
        predictor: the network.
        publish: is called with the header of the scan, the frame of its pose and the map.
        warn: is called with the reason for which a scan is skipped or has no map.
        center: center of the map, `robot` or x, y in the frame of the poses [m].
        steps: steps of a window, T; None for those of the training.
        step_s: time of a step [s]; None for that of the training.
        range_max_m: maximum range of the lidar [m]; None for that of its messages.

    Raises:
        ValueError: the center is neither `robot` nor a point, the network needs a fixed one, or the range is not
            positive.
    """

    def __init__(
        self,
        predictor: Predictor,
        publish: Callable[[Any, str, StreamMap], None],
        warn: Callable[[str], None],
        *,
        center: str | tuple[float, float] = "robot",
        steps: int | None = None,
        step_s: float | None = None,
        range_max_m: float | None = None,
    ) -> None:
        if range_max_m is not None and not range_max_m > 0:
            raise InputError(f"range_max_m: expected a positive range [m], got {range_max_m}")
        self.predictor, self.publish, self.warn, self.range_max_m = predictor, publish, warn, range_max_m
        center_point(predictor, center)  # refuses it now, not with the first scan
        self.center = center
        self.steps, self.step_s = predictor.window(steps, step_s)
        self.transforms = Transforms(KEEP_S)
        self.waiting: deque[Any] = deque()
        self.without_transform: set[str] = set()  # frames of scans that nobody places
        self.reported: set[str] = set()  # messages about poses that cannot be used
        self.newest_s = -np.inf  # time of the newest scan; poses may be stamped ahead of it
        self.first: LogScan | None = None
        self.stream: PredictionStream | None = None  # whose misses reach the smallest maximum range
        self.others = 0  # scans in a row with other beams
        self.root: str | None = None  # frame of the poses in the stream
        self.last_s = -np.inf  # time of the last scan in the stream
        self.lock = threading.Lock()

    def add_scan(self, message: Any) -> None:
        """Take a LaserScan.

        If it is earlier than the last one in the stream by more than a window, the clock was set back. If it is that
        much earlier than another scan, the time of the other one was wrong.
        """
        with self.lock:
            stamp, window_s = seconds(message.header.stamp), self.steps * self.step_s
            if stamp < self.last_s - window_s:
                self._restart()
            elif stamp < self.newest_s - window_s:
                self._drop_later(stamp)
            self.waiting.append(message)
            if len(self.waiting) > MAX_WAITING:
                self.waiting.popleft()
                self.warn(f"a scan is skipped: {MAX_WAITING} others wait for poses or for the network")
            self.newest_s = max(self.newest_s, stamp)
            self._predict()

    def add_transforms(self, message: Any, *, is_static: bool = False) -> None:
        """Take a TFMessage."""
        with self.lock:
            add_transforms(self.transforms, message, is_static=is_static)
            self._report()
            self._predict()

    def add_odometry(self, message: Any) -> None:
        """Take an Odometry message."""
        with self.lock:
            add_odometry(self.transforms, message)
            self._report()
            self._predict()

    def _report(self) -> None:
        """Warn once of every kind of poses that cannot be used."""
        for message in self.transforms.left_out.keys() - self.reported:
            self.reported.add(message)
            self.warn(message)

    def _restart(self) -> None:
        """Forget all scans and poses, as the stream does with its scans; static transforms stay."""
        self.warn("the clock was set back: the window begins again")
        self.transforms.forget()
        self.waiting.clear()
        self.newest_s = self.last_s = -np.inf

    def _drop_later(self, stamp: float) -> None:
        """Skip the waiting scans that are later than a time [s]."""
        earlier = [message for message in self.waiting if seconds(message.header.stamp) <= stamp]
        if skipped := len(self.waiting) - len(earlier):
            self.warn(f"{skipped} scans are skipped: their times are ahead of a later scan")
        self.waiting, self.newest_s = deque(earlier), stamp

    def _predict(self) -> None:
        """Predict maps for the scans that have their poses, or have waited too long for them."""
        while self.waiting:
            frame, middle_s = self.waiting[0].header.frame_id, middle_of(self.waiting[0])
            is_late = self.newest_s > middle_s + MAX_GAP_S
            is_placed = frame in self.transforms or frame in self.without_transform
            if not is_late and not (is_placed and self.transforms.has_later(frame, middle_s)):
                return
            if is_late and not is_placed:
                self.without_transform.add(frame)
                self.warn(without_transform(frame, self.transforms.base_of(frame)))
            self._update(self.waiting.popleft())

    def _update(self, message: Any) -> None:
        try:
            scan = log_scan(message, self.transforms)
            if self.range_max_m is not None:
                scan = replace(scan, range_max_m=self.range_max_m)
            root = self.transforms.root(message.header.frame_id)
            if self.first is not None and scan.pose is not None and root != self.root:
                self.warn(f"the poses are in the frame {root} now, not in {self.root}: the window begins again")
                self.first = None
            is_placed = scan.pose is not None and len(scan.ranges) > 0  # without a pose it may be upside down
            if self.first is not None and is_placed and not has_same_beams(scan, self.first):
                self.others += 1
                if self.others > MOST_OTHERS:
                    self.warn("the beams of the lidar have changed: the window begins again")
                    self.first = None
            if self.first is None and len(scan.ranges) and has_valid_range(scan):
                check_beams(scan, "scan")
            reason = why_unusable(scan, self.first, self.last_s)
            if reason == WITHOUT_POSE:
                reason += f": {self.transforms.why_unplaced(message.header.frame_id, middle_of(message))}"
            if reason:
                raise InputError(f"a scan is skipped: it is {reason}")
            predicted = self._map(scan)
            self.root = root
        except ValueError as error:
            self.warn(str(error))
            return
        if predicted is not None:
            self.publish(message.header, root, predicted)

    def _map(self, scan: LogScan) -> StreamMap | None:
        angles = scan.first_angle + scan.spacing * np.arange(len(scan.ranges))
        angles, ranges = in_order(angles, valid_ranges(scan)[None])
        if self.first is None or self.stream is None:
            self.stream = PredictionStream(
                self.predictor.with_range(scan.range_max_m),
                angles,
                center=self.center,
                steps=self.steps,
                step_s=self.step_s,
            )
            if message := note_on_range(scan.range_max_m, self.predictor.reach_m):
                self.warn(message)
            self.first = scan
        elif scan.range_max_m < self.stream.predictor.reach_m:  # all misses take the smallest, as in `collect`
            self.warn(f"the maximum range changes: misses show free space up to the smallest, {scan.range_max_m:.4g} m")
            self.stream.limit(scan.range_max_m)
        self.last_s, self.others = scan.stamp, 0
        return self.stream.update(ranges[0], np.array(scan.pose), scan.stamp)
