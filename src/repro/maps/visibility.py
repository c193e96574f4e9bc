"""Visibility of pixels to a lidar: the newest step at which each pixel was in view and not occluded."""

import math
from typing import Any

import numpy as np

from repro.maps.grid import Grid
from repro.scans import Scans
from repro.system.compiled import compiled
from repro.system.errors import InputError
from repro.system.threads import in_threads

_RAYS = 720  # of `shown_pixels`, one every half degree, a pixel apart at 22 m for one of 0.2 m


def newest_visible(scans: Scans, grid: Grid, range_max_m: float, *, margin_m: float = 0.0) -> np.ndarray:
    """Return the newest step at which each pixel was visible.

    A pixel is in view at a step if its center is within the range of the lidar and within half the beam spacing of a
    beam. It is visible if it is also no farther away than the range of that beam. The result depends only on the scans,
    not on the true map.

    Args:
        scans: a batch of windows, see `Scans.batched`; the beam angles are evenly spaced and increasing.
        range_max_m: maximum range of the lidar [m].
        margin_m: distance behind the end of a beam up to which a pixel counts as visible [m]: plus half a pixel
            includes the surface that was hit, minus half a pixel excludes it.

    Returns:
        the step, counted from 1, 0 for never, int16, (B, H, W).

    Raises:
        InputError: the beam angles are not evenly spaced and increasing, or a window has too many steps for int16.
    """
    return _drawn(scans, grid, range_max_m, margin_m, counts=False)


def count_passed(scans: Scans, grid: Grid, range_max_m: float) -> np.ndarray:
    """Return the number of steps at which a beam passed over each pixel, int16, (B, H, W), see `newest_passed`."""
    return _drawn(scans, grid, range_max_m, -grid.resolution_m / 2, counts=True)


def newest_passed(scans: Scans, grid: Grid, range_max_m: float) -> np.ndarray:
    """Return the newest step at which a beam passed over each pixel, observed free, see `newest_visible`."""
    return newest_visible(scans, grid, range_max_m, margin_m=-grid.resolution_m / 2)


def newest_in_view(scans: Scans, grid: Grid, range_max_m: float) -> np.ndarray:
    """Return the newest step at which each pixel was in view, occluded or not, see `newest_visible`."""
    return newest_visible(Scans(np.full_like(scans.ranges, np.inf), scans.angles, scans.poses), grid, range_max_m)


def _drawn(scans: Scans, grid: Grid, range_max_m: float, margin_m: float, *, counts: bool) -> np.ndarray:
    """Return the newest step at which each pixel was visible, or the number of these steps, see `newest_visible`."""
    spacing = beam_spacing(scans.angles)
    steps, most = scans.ranges.shape[1], np.iinfo(np.int16).max
    if steps > most:
        raise InputError(f"expected windows of at most {most} steps, got {steps}")
    # a miss reaches the maximum range, or less by the margin if that is negative
    length = np.minimum(np.minimum(scans.ranges, range_max_m) + margin_m, range_max_m)
    length = length.astype(float) / grid.resolution_m
    poses = scans.poses.astype(float)
    poses = np.concatenate([poses[..., :2] / grid.resolution_m - 0.5, poses[..., 2:]], axis=-1)
    bounds = float(scans.angles[0]) + spacing * (np.arange(len(scans.angles) + 1) - 0.5)  # of the beams' sectors
    bounds = np.stack([np.cos(bounds), np.sin(bounds)], axis=-1)
    images = np.zeros((len(scans), grid.size_px, grid.size_px), dtype=np.int16)

    in_threads(lambda part: _draw_windows(images, length, poses, part, bounds, spacing, counts), len(scans))
    return images


def beam_spacing(angles: np.ndarray) -> float:
    """Return the angle between two adjacent beams [rad].

    Args:
        angles: beam angles [rad], (N,).

    Raises:
        InputError: the angles are not evenly spaced and increasing, or are half a turn apart or more.
    """
    gaps = np.diff(angles.astype(float))
    spacing = float(gaps.mean()) if len(gaps) else 0.0
    if not 0 < spacing < math.pi or np.abs(gaps - spacing).max() > 0.01 * spacing:
        raise InputError("the beam angles must rise evenly, by less than half a turn from beam to beam")
    return spacing


@compiled
def _draw_windows(
    images: np.ndarray,
    length: np.ndarray,
    poses: np.ndarray,
    part: np.ndarray,
    bounds: np.ndarray,
    spacing: float,
    counts: bool,
) -> None:
    """Draw the steps of some windows, oldest first, each as the sectors covered by its beams.

    Args:
        images: the images, (B, H, W).
        length: visible distance along each beam [px], (B, T, N); a negative one or NaN draws nothing.
        poses: column and row from below of the robot [px], with pixel centers at integers, and heading [rad],
            (B, T, 3).
        part: indices of the windows.
        bounds: directions (cosine, sine) between the sectors of the beams in the robot's frame, (N + 1, 2).
        spacing: angle between two adjacent beams [rad].
        counts: whether the images are of the number of steps, and not of the newest one, counted from 1.
    """
    beams = length.shape[2]
    for window in part:
        for step in range(length.shape[1]):
            x, y, heading = poses[window, step]
            if not math.isfinite(x + y + heading):
                continue  # nothing is visible from an unknown pose
            turn = (math.cos(heading), math.sin(heading))
            beam, start = 0, _turned(bounds[0], turn)
            while beam < beams:
                radius, end = length[window, step, beam], beam + 1
                while end < beams and length[window, step, end] == radius and (end + 1 - beam) * spacing < math.pi / 2:
                    end += 1  # adjacent beams of equal length, such as misses, form one sector
                stop = _turned(bounds[end], turn)
                if radius >= 0:
                    _draw_sector(images[window], x, y, start, stop, radius, int(counts), 1 if counts else step + 1)
                beam, start = end, stop


@compiled
def _turned(direction: np.ndarray, turn: tuple[float, float]) -> tuple[float, float]:
    """Turn a direction (cosine, sine) by an angle with this cosine and sine."""
    return direction[0] * turn[0] - direction[1] * turn[1], direction[1] * turn[0] + direction[0] * turn[1]


@compiled
def _draw_sector(
    image: np.ndarray,
    x: float,
    y: float,
    start: tuple[float, float],
    stop: tuple[float, float],
    radius: float,
    kept: int,
    value: int,
) -> None:
    """Draw the part of a disc between two directions (cosine, sine), less than half a turn apart, row by row.

    Its pixels get a value, added to `kept` times the one before.

    A pixel on `start` belongs to the sector and one on `stop` does not, so that adjacent sectors neither overlap nor
    leave a gap.
    """
    size = len(image)
    from_cos, from_sin, to_cos, to_sin = start[0], start[1], stop[0], stop[1]
    lowest, highest = radius * min(0.0, from_sin, to_sin), radius * max(0.0, from_sin, to_sin)
    if from_cos * to_cos <= 0:  # the sector contains a y axis direction
        lowest, highest = (lowest, radius) if from_sin + to_sin > 0 else (-radius, highest)
    from_slope, to_slope = from_cos / (from_sin or 1.0), to_cos / (to_sin or 1.0)
    inner = radius * min(abs(from_sin), abs(to_sin)) if from_sin * to_sin > 0 else 0.0  # here the rays are the bounds
    for row in _whole(y + lowest, y + highest, size):
        up = row - y
        half = math.inf if abs(up) < inner else math.sqrt(max(0.0, radius * radius - up * up))
        left, right = x - half, x + half
        # left of or on the ray at `start`
        if from_sin > 0:
            right = min(right, x + up * from_slope)
        elif from_sin < 0:
            left = max(left, x + up * from_slope)
        elif from_cos * up < 0:
            continue
        # right of the ray at `stop`
        if to_sin > 0:
            left = max(left, np.floor(x + up * to_slope) + 1)
        elif to_sin < 0:
            right = min(right, np.ceil(x + up * to_slope) - 1)
        elif to_cos * up >= 0:
            continue
        for column in _whole(left, right, size):
            image[size - 1 - row, column] = kept * image[size - 1 - row, column] + value


@compiled
def _whole(low: float, high: float, size: int) -> range:
    """Return the integers from 0 to size - 1 between `low` and `high` inclusive; the two bounds may be any number."""
    low, high = max(0.0, np.ceil(low)), min(size - 1.0, np.floor(high))
    return range(int(low), int(high) + 1) if low <= high else range(0)


def shown_pixels(maps: np.ndarray, poses: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the pixels that a lidar of 360 degrees would show: those before the first obstacle of a ray, and this one.

    Args:
        maps: true maps, uint8, (B, H, W); 1 is free.
        poses: poses of the lidars x, y [m], heading [rad], (B, 3).

    Returns:
        whether each pixel is shown, bool, (B, H, W).
    """
    bearings = np.arange(_RAYS, dtype=np.float32) * np.float32(2 * math.pi / _RAYS)
    distances = np.arange(0, math.sqrt(2) * grid.size_m, grid.resolution_m / 2).astype(np.float32)
    ways = np.stack([np.cos(bearings), np.sin(bearings)], -1)[:, None] * distances[:, None]  # (rays, samples, 2)
    shown, places = np.zeros(maps.shape, dtype=bool), poses[:, :2].astype(np.float32)
    in_threads(lambda part: _draw_shown(shown, maps, places, ways, part, np.float32(grid.resolution_m)), len(maps))
    return shown


@compiled
def _draw_shown(
    shown: np.ndarray, maps: np.ndarray, places: np.ndarray, ways: np.ndarray, part: np.ndarray, resolution_m: Any
) -> None:
    """Draw what lidars show of some maps, see `shown_pixels`, given the samples of their rays, (rays, samples, 2)."""
    size = maps.shape[1]
    for index in part:
        for ray in range(ways.shape[0]):
            for sample in range(ways.shape[1]):
                column = np.floor((places[index, 0] + ways[ray, sample, 0]) / resolution_m)
                above = np.floor((places[index, 1] + ways[ray, sample, 1]) / resolution_m)
                if not (0 <= column < size and 0 <= above < size):
                    continue
                shown[index, size - 1 - int(above), int(column)] = True
                if maps[index, size - 1 - int(above), int(column)] == 0:
                    break
