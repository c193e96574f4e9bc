"""Poses of the frames of a robot over time, as ROS transforms and odometry tell them, composed and interpolated."""

import math
from collections.abc import Iterator

from repro.logs.poses import MAX_GAP_S, Edge, PlanarPose, Vector, in_plane, problem_of
from repro.logs.rotations import UPSIDE_DOWN, RigidTransform, Rotation
from repro.system.errors import InputError

BASES = ("base_link", "base_footprint")  # frames of the robot itself, by REP 105 of ROS
MAX_TILT = math.radians(30)  # of a lidar whose beams are taken as horizontal


class Transforms:
    """The tree of frames.

    Args:
        keep_s: age beyond which poses are forgotten [s]; None keeps all.
        frame: frame in which poses are taken, such as `odom`; None for the topmost one.
        mounting: x, y [m] and heading [rad] of every lidar on the robot, in place of its transforms; None for those.
        pose: x, y [m] and heading [rad] of a lidar that stands, in place of all transforms; None for one that moves.
            With a pose or a mounting, the transforms still tell whether the lidar is upside down.
    """

    def __init__(
        self,
        keep_s: float | None = None,
        *,
        frame: str | None = None,
        mounting: Vector | None = None,
        pose: tuple[float, float, float] | None = None,
    ) -> None:
        self.keep_s, self.frame = keep_s, frame and frame.lstrip("/")
        self.mounting, self.pose = mounting, pose
        self.edges: dict[str, Edge] = {}
        self.left_out: dict[str, None] = {}  # messages about poses that cannot be used, in the order of their arrival

    def add(
        self, child: str, parent: str, stamp: float, position: Vector, quaternion: Vector, *, is_static: bool = False
    ) -> None:
        """Add the pose of a frame in its parent frame at a time [s]: x, y, z [m] and a quaternion x, y, z, w.

        A static pose replaces the one before, and poses that change replace a static one, also one in another parent:
        odometry of `base_link` that is static in `base_footprint`. Poses in another parent than the first are left out
        otherwise: the tree of frames would change with each of them. See `Edge.insert`.
        """
        child, parent = child.lstrip("/"), parent.lstrip("/")
        if problem := problem_of(stamp, position, quaternion):
            self.left_out[f"poses of {child} are left out: {problem}"] = None
            return
        pose = RigidTransform.from_components(position, Rotation.from_quat(quaternion))
        edge = self.edges.get(child)
        if edge and edge.is_static and is_static and edge.differs(parent, pose):
            text = f"{child} has several static poses, in {edge.parent} and {parent}: the last holds; "
            self.left_out[f"{text}prediction.mounting, of a node mounting, chooses"] = None
        if edge is None or edge.is_static:
            self.edges[child] = Edge(parent, is_static, [stamp], [pose])
        elif not is_static and edge.parent != parent:
            self.left_out[f"poses of {child} in {parent} are left out: it has poses in {edge.parent}"] = None
        elif not is_static:
            edge.insert(stamp, pose, self.keep_s)

    def pose_at(self, frame: str, stamp: float) -> PlanarPose | None:
        """Return the pose of a frame at a time [s], in the chosen frame or in its last parent.

        Returns:
            the pose; None if a transform on the way is not known at that time, or if all are static: the poses of the
            robot are missing.

        Raises:
            InputError: the frame is tilted by more than `MAX_TILT`.
        """
        if self.pose is not None:
            return PlanarPose(*self.pose, is_upside_down=self._is_upside_down(frame))
        edges, total = list(self._chain(frame)), RigidTransform.identity()
        if all(edge.is_static for edge in edges) or _is_single(edges, stamp) or not self._reaches_frame(edges):
            return None
        for _, pose in _poses(edges, stamp):
            if pose is None:
                return None
            total = pose * total
        tilt = math.acos(min(abs(total.rotation.as_matrix()[2, 2]), 1.0))
        if tilt > MAX_TILT:
            raise InputError(
                f"{frame} is tilted by {math.degrees(tilt):.0f} degrees: expected a horizontal lidar, "
                f"within {math.degrees(MAX_TILT):.0f} degrees"
            )
        return in_plane(total)

    def _reaches_frame(self, edges: list[Edge]) -> bool:
        return self.frame is None or (bool(edges) and edges[-1].parent == self.frame)

    def why_unplaced(self, frame: str, stamp: float) -> str | None:
        """Return why a frame has no pose at a time [s]; None if it has one."""
        edges, name = list(self._chain(frame)), frame.lstrip("/")
        if not edges and self.mounting is None:
            return f"no transform of {name}: set prediction.mounting, of a node mounting, to x,y,heading on the robot"
        if not edges:
            moving = [other for other, edge in self.edges.items() if not edge.is_static]
            return f"no frame of the robot: expected {' or '.join(BASES)}, or one that moves, got {moving}"
        if not self._reaches_frame(edges):
            return f"the frame {self.frame} is not above {name}, but {', '.join(edge.parent for edge in edges)}"
        if all(edge.is_static for edge in edges):
            moving = [f"{other} in {edge.parent}" for other, edge in self.edges.items() if not edge.is_static]
            known = f"the poses are of {', '.join(moving)}" if moving else "there are no poses"
            return f"{edges[-1].parent}, above {name}, has no poses; {known}"
        if _is_single(edges, stamp):
            child = next(other for other, edge in self.edges.items() if edge in edges and not edge.is_static)
            return f"there is one single pose of {child}: for a lidar that stands, set prediction.pose=fixed"
        missing = next((edge for edge, pose in _poses(edges, stamp) if pose is None), None)
        if missing is None:
            return None
        child = next(other for other, edge in self.edges.items() if edge is missing)
        needed = f"poses of {child} in {missing.parent} before and after {stamp:.2f} s, at most {MAX_GAP_S:g} s apart"
        return f"it needs {needed}; there are poses from {missing.stamps[0]:.2f} to {missing.stamps[-1]:.2f} s"

    def has_later(self, frame: str, stamp: float) -> bool:
        """Return whether later poses than a time [s] are known up to the odometry, so that `pose_at` can interpolate.

        A correction above it, such as `odom` in `map`, may be rare: the last one holds.
        """
        has_poses = False
        for edge in self._chain(frame):
            if not edge.is_static and (len(edge.stamps) < 2 or edge.stamps[-1] < stamp):
                return False
            has_poses = has_poses or not edge.is_static
            if edge.moves:
                return True
        return has_poses

    def root(self, frame: str) -> str:
        """Return the last parent of a frame."""
        parents = [edge.parent for edge in self._chain(frame)]
        return parents[-1] if parents else frame.lstrip("/")

    def _is_upside_down(self, frame: str) -> bool:
        """Return whether the static transforms, where there are some, turn a frame upside down on the robot."""
        total = RigidTransform.identity()
        for edge in self._chain_of(frame.lstrip("/")):
            if edge.moves:
                break
            total = edge.poses[0] * total
        return in_plane(total).is_upside_down

    def moves(self, frame: str) -> bool:
        """Return whether poses that change place a frame."""
        return any(not edge.is_static for edge in self._chain_of(frame.lstrip("/")))

    def _base_of(self, frame: str) -> str | None:
        """Return the frame of the robot of a lidar: one of `BASES` in its namespace, or the only one that moves."""
        namespace = frame.rpartition("/")[0]
        for name in (f"{namespace}/{base}".lstrip("/") for base in BASES):
            if name in self.edges:
                return name
        moving = [name for name, edge in self.edges.items() if not edge.is_static]
        return moving[0] if len(moving) == 1 else None

    def _chain(self, frame: str) -> Iterator[Edge]:
        """Yield the transforms from a frame up to the chosen one, with the mounting in place of the first ones."""
        name = frame.lstrip("/")
        if self.mounting is not None:
            base = self._base_of(name)
            if base is None:
                return
            x, y, heading = self.mounting
            turn = Rotation.about_z(heading) * (UPSIDE_DOWN if self._is_upside_down(name) else Rotation())
            yield Edge(base, True, [0.0], [RigidTransform.from_components((x, y, 0.0), turn)])
            name = base
        yield from self._chain_of(name)

    def _chain_of(self, name: str) -> Iterator[Edge]:
        for _ in range(len(self.edges)):  # no more steps than frames, so that a cycle ends
            if name not in self.edges or name == self.frame:
                return
            yield self.edges[name]
            name = self.edges[name].parent


def _is_single(edges: list[Edge], stamp: float) -> bool:
    """Return whether one pose, of another time [s], is all that is known of the motion."""
    changing = [edge for edge in edges if not edge.is_static]
    far = any(abs(stamp - edge.stamps[0]) > MAX_GAP_S for edge in changing)
    return far and all(len(edge.stamps) == 1 for edge in changing)


def _poses(edges: list[Edge], stamp: float) -> Iterator[tuple[Edge, RigidTransform | None]]:
    """Yield transforms from a frame upward with their poses at a time [s]; those above the odometry are corrections."""
    has_odometry = False
    for edge in edges:
        yield edge, edge.at(stamp, is_correction=has_odometry)
        has_odometry = has_odometry or edge.moves
