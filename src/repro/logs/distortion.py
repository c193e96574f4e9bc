"""Scans of a lidar that moved while it swept: every beam is placed at its own time, as laser_geometry does with tf2."""

import math
from dataclasses import replace

import numpy as np

from repro.logs.log_scan import LogScan
from repro.logs.poses import PlanarPose
from repro.logs.times import nearest_of
from repro.scans import wrapped

NEGLIGIBLE_M = 0.01  # way of the lidar within half a scan; a turn is negligible up to half the angle between two beams


def undistorted(scan: LogScan, begin: PlanarPose, end: PlanarPose) -> LogScan:
    """Return a scan as if all beams had been measured at its pose, that of its middle.

    The lidar moves evenly in each half. A beam of the result takes the reading that is nearest in angle, NaN if there
    is none, as at the seam of a full turn.

    Args:
        scan: the scan, whose beams follow one another evenly in time.
        begin, end: poses of the lidar at the first and the last beam.
    """
    assert scan.pose is not None, "the middle is known"
    count, (x, y, heading) = len(scan.ranges), scan.pose
    turns = [float(wrapped(pose.heading - heading)) for pose in (begin, end)]
    moved_m = max(math.hypot(pose.x - x, pose.y - y) for pose in (begin, end))
    if count < 2 or (max(map(abs, turns)) < 0.5 * abs(scan.spacing) and moved_m < NEGLIGIBLE_M):
        return scan
    halves, share = [0, 0.5, 1], np.linspace(0, 1, count)
    aside = np.interp(share, halves, [begin.x - x, 0, end.x - x]), np.interp(share, halves, [begin.y - y, 0, end.y - y])
    angles = scan.first_angle + scan.spacing * np.arange(count)
    directions = angles + np.interp(share, halves, [turns[0], 0, turns[1]])
    ranges = scan.ranges.astype(float)
    with np.errstate(invalid="ignore"):  # of NaN
        hit = (ranges > max(scan.range_min_m, 0)) & (ranges < scan.range_max_m)
    hit_m = np.where(hit, ranges, 0)
    ahead, left = aside[0] + hit_m * np.cos(heading + directions), aside[1] + hit_m * np.sin(heading + directions)
    longest = np.nextafter(np.float32(scan.range_max_m), np.float32(0))
    ranges[hit] = np.hypot(ahead, left)[hit].clip(scan.range_min_m, longest)
    directions[hit] += wrapped(np.arctan2(left, ahead) - heading - directions)[hit]
    return replace(scan, ranges=_nearest(ranges, directions, angles).astype(np.float32))


def _nearest(ranges: np.ndarray, directions: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the ranges (N,) of the beams at some angles [rad], NaN where no direction is as near as the next beam."""
    turns = 2 * np.pi * np.array([[-1], [0], [1]])
    everywhere, index = (directions + turns).ravel(), np.tile(np.arange(len(ranges)), 3)
    order = np.argsort(everywhere)
    known = everywhere[order]
    nearest = nearest_of(known, angles)
    is_near = np.abs(known[nearest] - angles) <= abs(angles[1] - angles[0])
    return np.where(is_near, ranges[index[order[nearest]]], np.nan)
