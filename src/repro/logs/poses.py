"""Poses: of a frame in the plane, and of one frame in another over time, interpolated."""

import math
from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from repro.logs.rotations import RigidTransform

MAX_GAP_S = 2.0  # between two poses of a robot that moved in between; slow odometry has one in 1.25 s
MAX_CORRECTION_GAP_S = 1.0  # between two corrections of a localization, beyond which the first holds up to the other
TOLERANCE_S = 0.05
STILL_M, STILL_RAD = 0.05, math.radians(1)  # a frame that moved by less stood still, whatever the time between
DISORDER_S = 5.0  # by which a pose may be earlier than the one that arrived before it
MAX_NORM_ERROR = 0.1  # of a quaternion; tf2 allows 0.01 of its square, and some drivers round to two digits
MAX_PLACE_M = 1e7  # float64 of an uninitialized message are beyond it, UTM coordinates are not
Vector = tuple[float, ...]
MAX_BEYOND_S = 0.1  # between a scan and the first or last pose, which then stands in


@dataclass(frozen=True)
class PlanarPose:
    """The pose of a frame in the plane.

    Args:
        x, y: position [m].
        heading: direction of its x axis [rad].
        is_upside_down: whether its z axis points down, so that its angles count clockwise.
    """

    x: float
    y: float
    heading: float
    is_upside_down: bool = False


@dataclass(eq=False)
class Edge:
    """The poses of one frame in its parent frame, in the order of time; a single pose holds at all times."""

    parent: str
    is_static: bool
    stamps: list[float]
    poses: list[RigidTransform]
    moves: bool = False  # whether two of its poses differ

    def at(self, stamp: float, *, is_correction: bool = False) -> RigidTransform | None:
        """Return the pose at a time.

        Between two poses it is interpolated, as in tf2, but not over a gap in which the frame moved. A correction, such
        as `odom` in `map`, is then that before the gap, or after the last one.

        Returns:
            the pose; None if it is not known.
        """
        if not self.moves:
            return self.poses[0]
        after = bisect_left(self.stamps, stamp)
        if after == len(self.stamps):
            return self.poses[-1] if is_correction or stamp - self.stamps[-1] <= MAX_BEYOND_S else None
        if after == 0:
            return self.poses[0] if self.stamps[0] - stamp <= MAX_BEYOND_S else None
        one, other = self.poses[after - 1 : after + 1]
        gap = self.stamps[after] - self.stamps[after - 1]
        longest_s = MAX_CORRECTION_GAP_S if is_correction else MAX_GAP_S
        if gap > longest_s + TOLERANCE_S and not _are_near(one, other):
            return one if is_correction else None
        share = (stamp - self.stamps[after - 1]) / gap
        rotation = one.rotation.toward(other.rotation, share)
        return RigidTransform.from_components((1 - share) * one.translation + share * other.translation, rotation)

    def differs(self, parent: str, pose: RigidTransform) -> bool:
        """Return whether a static pose is another one than this."""
        return parent != self.parent or not _are_near(self.poses[0], pose, share=0.02)

    def insert(self, stamp: float, pose: RigidTransform, keep_s: float | None) -> None:
        """Insert a pose in the order of time; one at the same time is replaced.

        If poses are kept for some time only, one that is earlier than the last by more than `DISORDER_S` replaces all
        before it: a wrong time does not hide the poses after it.
        """
        if keep_s is not None and stamp < self.stamps[-1] - DISORDER_S:
            self.stamps, self.poses = [], []
        place = bisect_left(self.stamps, stamp)
        neighbor = self.poses[min(place, len(self.poses) - 1)] if self.poses else pose
        self.moves = self.moves or not _are_near(neighbor, pose, share=1e-3)
        is_again = self.stamps[place : place + 1] == [stamp]
        self.stamps[place : place + is_again], self.poses[place : place + is_again] = [stamp], [pose]
        if keep_s is not None and self.stamps[0] < self.stamps[-1] - 2 * keep_s:
            old = bisect_left(self.stamps, self.stamps[-1] - keep_s) - 1
            del self.stamps[:old], self.poses[:old]


def _are_near(one: RigidTransform, other: RigidTransform, share: float = 1.0) -> bool:
    """Return whether two poses are within a share of `STILL_M` and `STILL_RAD`."""
    moved_m = np.linalg.norm(one.translation - other.translation)
    return bool(moved_m <= share * STILL_M and (one.rotation.inv() * other.rotation).magnitude() <= share * STILL_RAD)


def in_plane(pose: RigidTransform) -> PlanarPose:
    x, y, _ = (float(value) for value in pose.translation)
    axes = pose.rotation.as_matrix()
    return PlanarPose(x, y, math.atan2(axes[1, 0], axes[0, 0]), bool(axes[2, 2] < 0))


def problem_of(stamp: float, position: Vector, quaternion: Vector) -> str | None:
    """Return what is wrong with a pose, such as one of an uninitialized message; None if nothing is."""
    if not math.isfinite(stamp) or not all(map(math.isfinite, (*position, *quaternion))):
        return "they are not finite"
    if max(map(abs, position)) > MAX_PLACE_M:
        return f"they are farther than {MAX_PLACE_M:g} m"
    length = math.hypot(*quaternion)
    return None if abs(length - 1) <= MAX_NORM_ERROR else f"a rotation is a quaternion of length {length:.3g}, not 1"
