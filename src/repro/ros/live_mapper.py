"""Maps from ROS messages as they arrive: the same for every version of ROS."""

from bisect import insort
from collections.abc import Callable
from operator import itemgetter
from typing import Any

import numpy as np

from repro.logs.log_scan import LogScan
from repro.logs.messages import LaserScans, ScanTimes, add_odometry, add_transforms, seconds
from repro.logs.options import WindowSettings
from repro.logs.readings import note_on_range
from repro.logs.reasons import Reason
from repro.logs.scan_filter import ScanFilter
from repro.logs.transforms import Transforms
from repro.networks.predictor import Predictor
from repro.prediction.stream import PredictionStream
from repro.prediction.stream_map import StreamMap
from repro.system.errors import InputError
from repro.system.threads import OneAtATime

KEEP_S = 30.0  # age up to which poses are remembered
WAIT_S = 10.0  # for the poses of a scan; transforms may be late on a busy computer
MAX_WAITING = 200  # scans that wait for their poses or for the network


class LiveMapper:
    """Predicts a map for every scan, once poses before and after it are known.

    Scans wait in the order of their times until their poses can be interpolated, as in the prediction from a bag, at
    most until one arrives that is later by `WAIT_S`, and the first ones for one another, see `ScanFilter`. Several
    threads may call the methods.

    Args:
        predictor: the network.
        publish: is called with the header of the scan, the frame of its pose and the map.
        warn: is called with the reason for which a scan is skipped or has no map.
        settings: the windows, see `options.window_of`.
        transforms: the tree of frames, with the frame of the poses and the mounting of the lidar; None for the usual.
    """

    def __init__(
        self,
        predictor: Predictor,
        publish: Callable[[Any, str, StreamMap], None],
        warn: Callable[[str], None],
        settings: WindowSettings,
        transforms: Transforms | None = None,
    ) -> None:
        self.predictor, self.publish, self.warn, self.settings = predictor, publish, warn, settings
        self.transforms = transforms or Transforms(KEEP_S)
        self.scans = LaserScans(warn)
        self.waiting: list[tuple[Any, ScanTimes]] = []  # scans with their times, in order
        self.newest_s = -np.inf  # time of the newest scan; poses may be stamped ahead of it
        self.is_early = False  # whether the last scan was earlier than another one by more than a window
        self.lock = OneAtATime("the mapper")
        self._begin_again()

    def _begin_again(self) -> None:
        """Begin a window, of a lidar whose beams are not known."""
        self.scan_filter = ScanFilter("scan", self.settings)
        self.stream: PredictionStream | None = None
        self.root: str | None = None  # frame of the poses in the stream

    def add_scan(self, message: Any) -> None:
        """Take a LaserScan; if two in a row are earlier than another by more than a window, the clock was set back."""
        with self.lock:
            stamp, window_s = seconds(message.header.stamp), self.settings.steps * self.settings.step_s
            was_early, self.is_early = self.is_early, stamp < self.newest_s - window_s
            if self.is_early and not was_early:
                self.warn(f"a scan is skipped: its time, {stamp:.2f} s, is earlier by more than a window")
                return
            if self.is_early:
                self.warn("the clock was set back: scans of later times are skipped")
                later = [(scan, times) for scan, times in self.waiting if times.first_s > stamp]
                self.waiting = [(scan, times) for scan, times in self.waiting if times.first_s <= stamp]
                for scan, times in later:
                    if self.transforms.why_unplaced(scan.header.frame_id, times.middle_s) is None:
                        self._take(scan, times)  # ends the window before
                self.newest_s, self.is_early = -np.inf, False
            insort(self.waiting, (message, self.scans.times(message)), key=itemgetter(1))
            if len(self.waiting) > MAX_WAITING:
                first, times = self.waiting.pop(0)
                why = self.transforms.why_unplaced(first.header.frame_id, times.middle_s) or "for the network"
                self.warn(f"a scan is skipped: {MAX_WAITING} others wait, {why}")
            self.newest_s = max(self.newest_s, stamp)
            self._predict()

    def add_transforms(self, message: Any, *, is_static: bool = False) -> None:
        """Take a TFMessage."""
        with self.lock:
            add_transforms(self.transforms, message, is_static=is_static)
            self._predict()

    def add_odometry(self, message: Any) -> None:
        """Take an Odometry message."""
        with self.lock:
            add_odometry(self.transforms, message)
            self._predict()

    def _predict(self) -> None:
        """Predict maps for the scans that have their poses, or have waited too long for them."""
        for text in self.transforms.left_out:
            self.scans.warn_once(text, text)
        while self.waiting:
            message, times = self.waiting[0]
            is_late = self.newest_s > times.middle_s + WAIT_S
            if not is_late and not self.transforms.has_later(message.header.frame_id, times.last_s):
                return
            self._take(*self.waiting.pop(0))

    def _take(self, message: Any, times: ScanTimes) -> None:
        """Take a scan whose pose is known or missing, and predict maps for the scans that can be used now."""
        scan, frame = self.scans.convert(message, times, self.transforms), message.header.frame_id
        root = self.transforms.root(frame)
        if scan.pose is not None and root != self.root:
            if self.root is not None:
                self.warn(f"the poses are in the frame {root} now, not in {self.root}: the window begins again")
                self._begin_again()
            self.root = root
        try:
            usable = self.scan_filter.add(scan)
        except InputError as error:
            self.warn(str(error))
            return
        for reason in self.scan_filter.reasons:
            why = f": {self.transforms.why_unplaced(frame, times.middle_s)}" if reason is Reason.NO_POSE else ""
            self.warn(f"a scan is skipped: it is {reason}{why}")
        for kind, note in self.scan_filter.notes.items():
            self.scans.warn_once(kind, note)
        for scan in usable:
            self._map(scan)

    def _map(self, scan: LogScan) -> None:
        """Predict the map of the window that ends with a scan, and publish it."""
        try:
            self.stream = self.stream or self._stream()
            predicted = self.stream.extend(scan)
        except InputError as error:
            self.warn(str(error))
            return
        if predicted is not None:
            self.publish(scan.header, str(self.root), predicted)
        elif self.stream.left_out is Reason.NOT_LATER:
            self.warn(f"a scan is skipped: {self.stream.reason}")

    def _stream(self) -> PredictionStream:
        if message := note_on_range(self.scan_filter.range_max_m, self.predictor.reach_m):
            self.warn(message)
        return PredictionStream(
            self.predictor,
            self.scan_filter.angles,
            center=self.settings.center,
            steps=self.settings.steps,
            step_s=self.settings.step_s,
            range_max_m=self.scan_filter.range_max_m,
            warn=lambda text: self.scans.warn_once(text, text),
        )
