"""Poses of the frames of a robot over time, as ROS transforms and odometry tell them, composed and interpolated."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

Pose = tuple[float, float, float]  # x, y [m], heading [rad]

BASES = ("base_link", "base_footprint")  # frames of the robot itself, by REP 105 of ROS
MAX_GAP_S = 1.0  # between two poses that are interpolated
MAX_BEYOND_S = 0.1  # between a scan and the first or last pose, which then stands in


@dataclass
class Edge:
    """The poses of one frame in its parent frame, in the order of time; a single pose holds at all times."""

    parent: str
    is_static: bool = False
    count: int = 0  # of all poses so far
    stamps: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)

    def at(self, stamp: float) -> Pose | None:
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
        share = (stamp - self.stamps[after - 1]) / gap if gap > 0 else 0.0
        (x, y, heading), (next_x, next_y, next_heading) = self.poses[after - 1 : after + 1]
        turn = (next_heading - heading + math.pi) % (2 * math.pi) - math.pi
        return x + share * (next_x - x), y + share * (next_y - y), heading + share * turn


class Transforms:
    """The tree of frames.

    Args:
        keep_s: age beyond which poses are forgotten [s]; None keeps all.
    """

    def __init__(self, keep_s: float | None = None) -> None:
        self.keep_s = keep_s
        self.edges: dict[str, Edge] = {}

    def __contains__(self, frame: str) -> bool:
        """Return whether a transform of a frame is known."""
        return frame.lstrip("/") in self.edges

    def add(self, child: str, parent: str, stamp: float, pose: Pose, *, is_static: bool = False) -> None:
        """Add the pose of a frame in its parent frame at a time [s]; a static pose replaces the one before."""
        edge = self.edges.setdefault(child.lstrip("/"), Edge(parent.lstrip("/"), is_static))
        edge.count += 1
        if edge.is_static:
            edge.stamps, edge.poses = [stamp], [pose]
            return
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

    def pose_at(self, frame: str, stamp: float) -> Pose | None:
        """Return the pose of a frame in its last parent at a time [s]; None if a transform on the way is not known.

        A frame without a transform, such as that of a lidar whose mounting is not published, is taken to be at the
        origin of the robot: of `BASES`, or else of the frame with the most poses.
        """
        x, y, heading = 0.0, 0.0, 0.0
        for edge in self._chain(frame):
            found = edge.at(stamp)
            if found is None:
                return None
            dx, dy, turn = found
            x, y = dx + math.cos(turn) * x - math.sin(turn) * y, dy + math.sin(turn) * x + math.cos(turn) * y
            heading += turn
        return (x, y, heading) if self.edges else None

    def has_later(self, frame: str, stamp: float) -> bool:
        """Return whether later poses than a time [s] are known on the whole way, so that `pose_at` will not change."""
        chain = list(self._chain(frame))
        return bool(chain) and all(
            edge.is_static or (len(edge.stamps) > 1 and edge.stamps[-1] >= stamp) for edge in chain
        )

    def root(self, frame: str) -> str:
        """Return the last parent of a frame."""
        parents = [edge.parent for edge in self._chain(frame)]
        return parents[-1] if parents else frame.lstrip("/")

    def _chain(self, frame: str) -> Iterator[Edge]:
        """Yield the transforms from a frame upward."""
        frame = frame.lstrip("/")
        if frame not in self.edges and self.edges:
            known = [name for name in BASES if name in self.edges]
            frame = known[0] if known else max(self.edges, key=lambda name: self.edges[name].count)
        for _ in range(len(self.edges)):  # no more steps than frames, so that a cycle ends
            if frame not in self.edges:
                return
            yield self.edges[frame]
            frame = self.edges[frame].parent


def lidar_at_base(frame: str) -> str:
    """Return the message about a lidar whose frame has no transform; see `Transforms.pose_at`."""
    return f"no transform of {frame}: the lidar is taken to be at the origin of the robot"
