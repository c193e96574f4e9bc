"""Statistics of the scans that a network was trained with, and whether other scans are within them.

A network gives some map for any scans. Scans whose statistics no training window had are a reason to doubt it.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from pydantic.dataclasses import dataclass

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.scans import Scans, wrapped
from repro.system.errors import InputError

LEVELS = (0.0, 0.01, 0.5, 0.99, 1.0)
MARGIN = 0.01  # of each bound, or of the range if that is wider; some are constant in training, as the field of view
ASSUMED = {"valid_share": (1.0, 1.0, 1.0, 1.0, 1.0)}  # of weights without it: simulated lidars lost no beam
MAY_EXCEED = ("beams",)  # a lidar with more beams in the same field of view draws nearly the same images
TITLES = {
    "valid_share": "share of the readings that are valid",
    "hit_share": "share of the beams with a hit",
    "occupied_share": "share of the pixels of the map with a hit",
    "hit_age_steps": "mean age of the newest hits of the pixels [steps]",
    "hit_range_m": "median range of the hits [m]",
    "path_m": "length of the path of the robot [m]",
    "turn_deg": "sum of the changes of its heading [degrees]",
    "fov_deg": "field of view [degrees]",
    "beams": "number of beams",
}


@dataclass(frozen=True)
class Statistics:
    """Quantiles of the statistics of training windows.

    Args:
        windows: number of windows.
        quantiles: the quantiles at `LEVELS` by the name of the statistic, see `TITLES`.
    """

    windows: int
    quantiles: dict[str, tuple[float, float, float, float, float]]

    @property
    def names(self) -> list[str]:
        """Return the names of the statistics whose range in training is known."""
        return [*(ASSUMED.keys() - self.quantiles.keys()), *self.quantiles]

    def range_of(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest value in training."""
        levels = self.quantiles[name] if name in self.quantiles else ASSUMED[name]
        return levels[0], levels[-1]

    def widened(self, other: "Statistics") -> "Statistics":
        """Return these statistics with the lowest and highest values of both trainings."""
        quantiles = {
            name: (min(levels[0], other.range_of(name)[0]), *levels[1:-1], max(levels[-1], other.range_of(name)[1]))
            for name, levels in ((name, self.quantiles.get(name, ASSUMED.get(name))) for name in other.quantiles)
            if levels is not None
        }
        return Statistics(self.windows + other.windows, quantiles)

    def outside(self, values: Mapping[str, float]) -> list[str]:
        """Return the names of the statistics that are outside their range in training by more than one percent of it.

        More beams than in training are not named, nor what a window without a hit does not have.
        """
        known = [name for name in self.names if not math.isnan(values.get(name, math.nan))]
        return [name for name in known if not self._covers(name, values[name])]

    def _covers(self, name: str, value: float) -> bool:
        low, high = self.range_of(name)
        width = high - low  # a robot that stands turns by 0 degrees, those of the training by 0.01 to 583
        is_enough = value >= low - MARGIN * max(abs(low), width)
        return is_enough and (value <= high + MARGIN * max(abs(high), width) or name in MAY_EXCEED)


def measure(scans: Scans, grid: Grid) -> dict[str, np.ndarray]:
    """Compute the statistics of windows of scans.

    Args:
        scans: a batch of windows, see `Scans.batched`, whose poses are on the map.

    Returns:
        one value per window, (B,), by the name of the statistic; NaN where a window has no hit.
    """
    ranges, angles, poses = (array.astype(float) for array in (scans.ranges, scans.angles, scans.poses))
    count, steps, beams = ranges.shape
    newest = newest_hits(scans, grid).reshape(count, -1)
    is_occupied = newest > 0
    moves = np.diff(poses, axis=1)
    hits = np.where(np.isfinite(ranges), ranges, np.nan).reshape(count, -1)
    with np.errstate(invalid="ignore"):  # of a window without a hit
        age_steps = ((steps - newest) * is_occupied).sum(1) / is_occupied.sum(1)
    return {
        "valid_share": 1 - np.isnan(ranges).mean((1, 2)),
        "hit_share": np.isfinite(ranges).mean((1, 2)),
        "occupied_share": is_occupied.mean(1),
        "hit_age_steps": age_steps,
        "hit_range_m": lower_median(hits),
        "path_m": np.linalg.norm(moves[..., :2], axis=-1).sum(1),
        "turn_deg": np.degrees(np.abs(wrapped(moves[..., 2])).sum(1)),
        "fov_deg": np.full(count, np.degrees(angles[-1] - angles[0])),
        "beams": np.full(count, float(beams)),
    }


def lower_median(values: np.ndarray) -> np.ndarray:
    """Return the median without NaN over the last axis, the lower of two values in the middle; NaN of none."""
    counts = np.isfinite(values).sum(-1, keepdims=True)
    return np.take_along_axis(np.sort(values, axis=-1), np.maximum(counts - 1, 0) // 2, axis=-1)[..., 0]


def summarize(batches: Iterable[Scans], grid: Grid) -> Statistics:
    """Compute the quantiles of the statistics of windows in batches, see `measure`; windows without a hit are left out.

    Raises:
        InputError: no window has a hit.
    """
    measured = [measure(batch, grid) for batch in batches]
    table = np.stack([np.concatenate([part[name] for part in measured]) for name in TITLES])
    table = table[:, np.isfinite(table).all(axis=0)]
    if not table.shape[1]:
        raise InputError("no training window has a hit: record other worlds")
    quantiles = np.quantile(table, LEVELS, axis=1).T
    rounded = {name: tuple(float(f"{v:.6g}") for v in row) for name, row in zip(TITLES, quantiles, strict=True)}
    return Statistics(table.shape[1], rounded)  # type: ignore[arg-type]
