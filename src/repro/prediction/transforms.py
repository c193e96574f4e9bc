"""Poses of the frames of a robot over time, as ROS transforms and odometry tell them, composed and interpolated."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from repro.system.errors import InputError

BASES = ("base_link", "base_footprint")  # frames of the robot itself, by REP 105 of ROS
MAX_GAP_S = 1.0  # between two poses that are interpolated
DISORDER_S = 5.0  # by which a pose may be earlier than the one that arrived before it
MAX_BEYOND_S = 0.1  # between a scan and the first or last pose, which then stands in
Vector = tuple[float, ...]
MAX_TILT = math.radians(30)  # of a lidar whose beams are taken as horizontal


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


@dataclass
class Edge:
    """The poses of one frame in its parent frame, in the order of time; a single pose holds at all times."""

    parent: str
    is_static: bool = False
    stamps: list[float] = field(default_factory=list)
    poses: list[RigidTransform] = field(default_factory=list)

    def at(self, stamp: float) -> RigidTransform | None:
        """Return the pose at a time, None if no poses are near it."""
        if len(self.stamps) <= 1:
            return self.poses[0] if self.poses else None
        after = bisect_left(self.stamps, stamp)
        if after in (0, len(self.stamps)):
            nearest = 0 if after == 0 else -1
            return self.poses[nearest] if abs(stamp - self.stamps[nearest]) <= MAX_BEYOND_S else None
        gap = self.stamps[after] - self.stamps[after - 1]
        if gap > MAX_GAP_S:
            return None
        share = (stamp - self.stamps[after - 1]) / gap
        one, other = self.poses[after - 1 : after + 1]
        rotation = Slerp([0, 1], Rotation.concatenate([one.rotation, other.rotation]))(share)
        return RigidTransform.from_components((1 - share) * one.translation + share * other.translation, rotation)


class Transforms:
    """The tree of frames.

    Args:
        keep_s: age beyond which poses are forgotten [s]; None keeps all.
    """

    def __init__(self, keep_s: float | None = None) -> None:
        self.keep_s = keep_s
        self.edges: dict[str, Edge] = {}
        self.left_out: dict[str, None] = {}  # messages about poses that cannot be used, in the order of their arrival

    def __contains__(self, frame: str) -> bool:
        """Return whether a transform of a frame is known."""
        return frame.lstrip("/") in self.edges

    def add(
        self, child: str, parent: str, stamp: float, position: Vector, quaternion: Vector, *, is_static: bool = False
    ) -> None:
        """Add the pose of a frame in its parent frame at a time.

        A static pose replaces the one before, and poses that change replace a static one. Poses in another parent than
        the first are left out: the tree of frames would change with each of them. If poses are kept for some time only,
        one that is earlier than the last by more than `DISORDER_S` replaces all before it: a wrong time does not hide
        the poses after it.

        Args:
            child: the frame.
            parent: its parent frame.
            stamp: time [s].
            position: x, y, z [m].
            quaternion: x, y, z, w; of any length but zero.
            is_static: whether the pose holds at all times.
        """
        child, parent = child.lstrip("/"), parent.lstrip("/")
        if not (np.isfinite((*position, *quaternion)).all() and any(quaternion)):
            self.left_out[f"poses of {child} are left out: they are not finite, or without a rotation"] = None
            return
        pose = RigidTransform.from_components(position, Rotation.from_quat(quaternion))
        edge = self.edges.setdefault(child, Edge(parent, is_static))
        if not edge.stamps or (edge.is_static and (is_static or edge.parent == parent)):
            edge.parent, edge.is_static, edge.stamps, edge.poses = parent, is_static, [stamp], [pose]
            return
        if edge.parent != parent:
            self.left_out[f"poses of {child} in {parent} are left out: it has poses in {edge.parent}"] = None
            return
        if is_static:
            return
        if self.keep_s is not None and stamp < edge.stamps[-1] - DISORDER_S:  # its time or that of the last is wrong
            edge.stamps, edge.poses = [], []
        place = bisect_right(edge.stamps, stamp)
        edge.stamps.insert(place, stamp)
        edge.poses.insert(place, pose)
        if self.keep_s is not None and edge.stamps[0] < edge.stamps[-1] - 2 * self.keep_s:
            old = bisect_left(edge.stamps, edge.stamps[-1] - self.keep_s) - 1
            del edge.stamps[:old], edge.poses[:old]

    def forget(self) -> None:
        """Remove all poses that are not static; their frames stay, so that scans wait for new ones."""
        for edge in self.edges.values():
            if not edge.is_static:
                edge.stamps, edge.poses = [], []

    def pose_at(self, frame: str, stamp: float) -> PlanarPose | None:
        """Return the pose of a frame in its last parent at a time.

        A frame without a transform, such as that of a lidar whose mounting is not published, is taken to be at the
        origin of the robot, see `base_of`.

        Args:
            frame: the frame.
            stamp: time [s].

        Returns:
            the pose; None if a transform on the way is not known at that time, or if all are static: the poses of the
            robot are missing.

        Raises:
            ValueError: the frame is tilted by more than `MAX_TILT`.
        """
        edges = list(self._chain(frame))
        if all(edge.is_static for edge in edges):
            return None
        total = RigidTransform.identity()
        for edge in edges:
            pose = edge.at(stamp)
            if pose is None:
                return None
            total = pose * total
        axes = total.rotation.as_matrix()
        tilt = math.acos(min(abs(axes[2, 2]), 1.0))
        if tilt > MAX_TILT:
            raise InputError(
                f"{frame} is tilted by {math.degrees(tilt):.0f} degrees: expected a horizontal lidar, "
                f"within {math.degrees(MAX_TILT):.0f} degrees"
            )
        x, y, _ = (float(value) for value in total.translation)
        return PlanarPose(x, y, math.atan2(axes[1, 0], axes[0, 0]), bool(axes[2, 2] < 0))

    def why_unplaced(self, frame: str, stamp: float) -> str:
        """Return why a frame has no pose at a time [s], where `pose_at` returns None."""
        edges = list(self._chain(frame))
        if all(edge.is_static for edge in edges):
            moving = [f"{name} in {edge.parent}" for name, edge in self.edges.items() if not edge.is_static]
            known = f"the poses are of {', '.join(moving)}" if moving else "there are no poses"
            return f"{self.root(frame)}, above {frame.lstrip('/')}, has no poses; {known}"
        edge = next(edge for edge in edges if edge.at(stamp) is None)
        name = next(name for name, other in self.edges.items() if other is edge)
        span = f"poses from {edge.stamps[0]:.2f} to {edge.stamps[-1]:.2f} s" if edge.stamps else "none yet"
        needed = f"poses of {name} in {edge.parent} before and after {stamp:.2f} s, at most {MAX_GAP_S:g} s apart"
        return f"it needs {needed}; there are {span}"

    def has_later(self, frame: str, stamp: float) -> bool:
        """Return whether later poses than a time [s] are known on the whole way, so that `pose_at` will not change."""
        chain = list(self._chain(frame))
        return not all(edge.is_static for edge in chain) and all(
            edge.is_static or (len(edge.stamps) > 1 and edge.stamps[-1] >= stamp) for edge in chain
        )

    def root(self, frame: str) -> str:
        """Return the last parent of a frame."""
        parents = [edge.parent for edge in self._chain(frame)]
        return parents[-1] if parents else frame.lstrip("/")

    def base_of(self, frame: str) -> str | None:
        """Return the frame of the robot, which stands in for a frame without a transform.

        It is one of `BASES` in the namespace of the frame, else one of `BASES` if all have the same namespace, else the
        only frame that moves.

        Returns:
            the name of the frame, None if there is none, or if several could be meant.
        """
        bases = [name for base in BASES for name in self.edges if name.rpartition("/")[2] == base]
        bases = [name for name in bases if _namespace(name) == _namespace(frame)] or bases
        if bases:
            return bases[0] if len({_namespace(name) for name in bases}) == 1 else None
        moving = [name for name, edge in self.edges.items() if not edge.is_static]
        return moving[0] if len(moving) == 1 else None

    def _chain(self, frame: str) -> Iterator[Edge]:
        """Yield the transforms from a frame upward."""
        name: str | None = frame.lstrip("/")
        if name not in self.edges:
            name = self.base_of(frame)
        for _ in range(len(self.edges)):  # no more steps than frames, so that a cycle ends
            if name not in self.edges:
                return
            yield self.edges[name]
            name = self.edges[name].parent


def without_transform(frame: str, base: str | None) -> str:
    """Return the message about a lidar whose frame has no transform, given what `Transforms.base_of` returns."""
    if base is None:
        return f"no transform of {frame}, and no single frame of the robot such as {BASES[0]}: its scans have no poses"
    return f"no transform of {frame}: the lidar is taken to be at the origin of the robot, {base}"


def _namespace(frame: str) -> str:
    return frame.lstrip("/").rpartition("/")[0]
