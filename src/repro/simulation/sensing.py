"""What real lidars and odometry do to scans: noise, drift, lost beams and scans."""

import dataclasses

import numpy as np

from repro.scans import Scans
from repro.worlds.spec import Sensing

RAD_PER_M = 0.05  # heading noise per position noise: at a range of 20 m both shift a hit equally


def sensed(scans: Scans, sensing: Sensing, range_max_m: float, rng: np.random.Generator) -> Scans:
    """Return a window as a real lidar and odometry would record it.

    Args:
        scans: exact scans, one window, as NumPy arrays.
        sensing: ranges of the errors, of which each is drawn once.
        range_max_m: maximum range of the exact scans [m]; a lidar that reaches less far has no reading of a miss.
    """
    every_beam, every_step = (
        int(rng.integers(low, high + 1)) for low, high in (sensing.every_beam, sensing.every_step)
    )
    limits = (sensing.range_m, sensing.noise_m, sensing.lost_share, sensing.odometry, sensing.pose_m)
    range_m, noise_m, lost_share, odometry, pose_m = (float(rng.uniform(*limit)) for limit in limits)
    moved = noisy_poses(drifted_poses(Scans.stack([scans]), odometry, rng), pose_m, rng).poses[0]
    moved[-1] = scans.poses[-1]
    scans = noisy_ranges(dataclasses.replace(scans, poses=moved), noise_m, rng)
    scans = skipped_scans(scans, every_step - 1, rng)
    reaches = np.where(np.isfinite(scans.ranges), scans.ranges, range_max_m) <= range_m
    has_reading = reaches & (rng.random(scans.ranges.shape) >= lost_share)
    has_reading &= np.arange(scans.ranges.shape[-1]) % every_beam == 0
    return dataclasses.replace(scans, ranges=np.where(has_reading, scans.ranges, np.nan))


def noisy_ranges(scans: Scans, std_m: float, rng: np.random.Generator) -> Scans:
    """Add normal noise to the range of every hit, above 0 afterwards; scans are NumPy arrays, `std_m` in meters."""
    noise = rng.normal(0, std_m, scans.ranges.shape)
    hit = np.isfinite(scans.ranges)
    return dataclasses.replace(scans, ranges=np.where(hit, (scans.ranges + noise).clip(1e-3), scans.ranges))


def noisy_poses(scans: Scans, std_m: float, rng: np.random.Generator) -> Scans:
    """Add normal noise to every pose: `std_m` [m] to x and y, 0.05 rad per meter of `std_m` to the heading."""
    noise = rng.normal(0, std_m, scans.poses.shape) * [1, 1, RAD_PER_M]
    return dataclasses.replace(scans, poses=scans.poses + noise)


def drifted_poses(scans: Scans, std: float, rng: np.random.Generator) -> Scans:
    """Draw for each window two scale errors of odometry, of distances and of turns, both normal with deviation `std`.

    The newest pose stays exact, as in a map around the robot; older poses deviate by what the errors add up to since.
    """
    distances, turns = 1 + rng.normal(0, std, (2, len(scans), 1))
    position, heading = scans.poses[..., :2], np.unwrap(scans.poses[..., 2], axis=-1)
    drifted = heading[:, -1:] + turns * (heading - heading[:, -1:])
    x, y = np.moveaxis(np.diff(position, axis=1), -1, 0) * distances
    turn = (drifted - heading)[:, :-1]
    steps = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=-1)
    ahead = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1]  # from each pose to the newest one
    position = np.concatenate([position[:, -1:] - ahead, position[:, -1:]], axis=1)
    return dataclasses.replace(scans, poses=np.concatenate([position, drifted[..., None]], axis=-1))


def skipped_scans(scans: Scans, skipped: float, _: np.random.Generator) -> Scans:
    """Skip a number of scans between any two, counted from the last; a step takes the nearest scan that is left."""
    count = scans.ranges.shape[-2]
    kept = np.arange(count - 1, -1, -1 - int(skipped))
    index = kept[np.abs(np.arange(count)[:, None] - kept).argmin(1)]
    return dataclasses.replace(scans, ranges=scans.ranges[..., index, :], poses=scans.poses[..., index, :])
