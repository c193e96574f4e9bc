"""Misses that are none: lost, masked or noisy beams that arrive as if nothing were there, and mark free space.

A real lidar shows hardly any of what is counted here: the limits lie between 13 logs of driving robots and 8 bags of a
standing lidar on one side, and lidars with lost beams on the other. A note states what was seen; who knows the lidar
decides.
"""

import math
from collections import deque

import numpy as np

from repro.scans import wrapped

NEWEST = 100  # scans in which misses are counted
FEWEST = 20  # of them, before they are judged
TURN = 1.0  # of the lidar [rad], by which a beam that sees nothing on one side sees something on another
MAX_ALWAYS = 0.02  # share of the beams that miss in every scan; 0 in the logs
MAX_ONLY = 0.05  # share of the scans without a hit; 0
MAX_BETWEEN = 0.03  # share of the readings that miss between two equal hits; 0.015
MAX_SHARE = 0.75  # share of the readings; 0.67
MAX_SCATTERED = 0.06  # share of the misses between two hits at the maximum range; 0.001
LEAST_MISSES = 100  # in NEWEST scans, of which a share is taken
EQUAL, EQUAL_M = 0.05, 0.1  # relative and absolute difference of two hits on the same obstacle
AT_MAXIMUM = 0.97  # of the maximum range
MAX_BEYOND = 0.005  # share of the readings beyond the maximum range that differ from one another
BEYOND_VALUES, BEYOND_SPREAD = 20, 0.05  # of such readings: different ones, and their spread, of the maximum range


class MissCheck:
    """Counts the misses of the scans of one lidar, and notes what a real lidar does not show.

    Attributes:
        notes: what was seen, by kind, at its worst.
    """

    def __init__(self) -> None:
        self.notes: dict[str, str] = {}
        self._worst: dict[str, float] = {}
        self._newest: deque[tuple[int, ...]] = deque(maxlen=NEWEST)
        self._scans = 0
        self._always = np.zeros(0, dtype=bool)
        self._turned = self._least = self._most = 0.0  # heading relative to that of the first scan [rad]
        self._heading = math.nan
        self._beyond: set[float] = set()

    def add(self, readings: np.ndarray, ranges: np.ndarray, heading: float, range_max_m: float) -> list[str]:
        """Count a scan, and return the notes of kinds that were not seen before.

        Args:
            readings: what the lidar reported [m], (N,).
            ranges: the same with inf for a miss and NaN for an invalid reading [m], (N,).
            heading: of the lidar [rad].
            range_max_m: smallest range that means a miss [m].
        """
        misses, known = np.isinf(ranges), set(self.notes)
        self._always = misses if self._always.shape != misses.shape else self._always & misses
        turn = 0.0 if math.isnan(self._heading) else float(wrapped(heading - self._heading))
        self._turned, self._heading, self._scans = self._turned + turn, heading, self._scans + 1
        self._least, self._most = min(self._least, self._turned), max(self._most, self._turned)
        self._newest.append(self._count(readings, ranges, misses, range_max_m))
        if len(self._newest) >= FEWEST:
            self._judge(range_max_m)
        return [note for kind, note in self.notes.items() if kind not in known]

    def _count(
        self, readings: np.ndarray, ranges: np.ndarray, misses: np.ndarray, range_max_m: float
    ) -> tuple[int, ...]:
        """Return the numbers of readings, misses, those between equal hits, of these at the maximum range, and readings
        beyond it; and 1 for a scan without a hit.
        """
        one, other, inner = ranges[:-2], ranges[2:], misses[1:-1]
        with np.errstate(invalid="ignore"):  # of inf - inf
            is_equal = inner & (np.abs(one - other) <= np.maximum(EQUAL * np.minimum(one, other), EQUAL_M))
        is_at_maximum = is_equal & (np.minimum(one, other) > AT_MAXIMUM * range_max_m)
        beyond = readings[np.isfinite(readings) & (readings > range_max_m)]
        if len(self._beyond) < NEWEST:
            self._beyond.update(beyond.tolist())
        counts = (int(is_counted.sum()) for is_counted in (misses, is_equal, is_at_maximum))
        return len(ranges), *counts, len(beyond), int(not np.isfinite(ranges).any())

    def _judge(self, range_max_m: float) -> None:
        readings, misses, equal, scattered, beyond, only = (sum(column) for column in zip(*self._newest, strict=True))
        always, beams, turn = int(self._always.sum()), len(self._always), self._most - self._least
        scans, between, share = len(self._newest), equal / readings, misses / readings
        if turn >= TURN:
            text = f"{always} of {beams} beams miss in all {self._scans} scans, while the lidar turns by "
            self._note("always", always / beams, MAX_ALWAYS, f"{text}{math.degrees(turn):.0f} degrees", LOST)
        self._note("only", only / scans, MAX_ONLY, f"{only} of {scans} scans have misses only", LOST)
        self._note("between", between, MAX_BETWEEN, f"{between:.1%} of the readings miss between two equal hits", LOST)
        self._note("share", share, MAX_SHARE, f"{share:.0%} of the readings are misses", LOST)
        text = f"{scattered} of {misses} misses are between two hits at the maximum range, {range_max_m:.4g} m"
        advice = f"misses vary around it: set range_max_m={AT_MAXIMUM * range_max_m:.3g}"
        self._note("scattered", scattered / max(misses, LEAST_MISSES), MAX_SCATTERED, text, advice)
        self._judge_beyond(beyond / readings, range_max_m)

    def _judge_beyond(self, share: float, range_max_m: float) -> None:
        """Note readings beyond the maximum range that are no constant, such as that of a driver for a miss."""
        if len(self._beyond) < BEYOND_VALUES:
            return
        low, high = np.quantile(list(self._beyond), [0.1, 0.9])
        if high - low >= BEYOND_SPREAD * range_max_m:
            text = f"{share:.1%} of the readings are beyond the maximum range, {range_max_m:.4g} m, such as {high:.4g}"
            self._note("beyond", share, MAX_BEYOND, text, "they count as misses; if they are hits, set range_max_m")

    def _note(self, kind: str, value: float, most: float, seen: str, advice: str) -> None:
        if value > most and value >= self._worst.get(kind, 0):
            self._worst[kind], self.notes[kind] = value, f"{seen}: {advice}"


LOST = (
    "beams that are lost or masked, but arrive as misses, mark free space; misses=invalid (prediction.misses of a "
    "call) takes misses as invalid"
)
