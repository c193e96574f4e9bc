"""Poses composed and interpolated, compared with matrices."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from repro.logs.transforms import Transforms as RigidTransforms


class Transforms(RigidTransforms):
    """Transforms with planar poses, x, y and heading."""

    def add(self, child, parent, stamp, pose, *, is_static=False) -> None:
        x, y, heading = pose
        turn = (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
        super().add(child, parent, stamp, (x, y, 0.0), turn, is_static=is_static)

    def pose_at(self, frame, stamp):
        found = super().pose_at(frame, stamp)
        return found and (found.x, found.y, found.heading)


def moving(stamps, xs, child="base", parent="odom", transforms=None) -> Transforms:
    transforms = transforms or Transforms()
    for stamp, x in zip(stamps, xs, strict=True):
        transforms.add(child, parent, stamp, (x, 0.0, 0.0))
    return transforms


def test_headings_are_interpolated_through_the_shorter_turn():
    transforms = Transforms()
    transforms.add("base", "odom", 1.0, (0.0, 0.0, math.pi - 0.1))
    transforms.add("base", "odom", 2.0, (1.0, 2.0, -math.pi + 0.1))
    assert transforms.pose_at("base", 1.25) == pytest.approx((0.25, 0.5, math.pi - 0.05))


@pytest.mark.parametrize(("stamp", "is_known"), [(0.85, False), (0.95, True), (1.5, True), (3.0, False), (5.15, False)])
def test_poses_are_known_near_others_only(stamp, is_known):
    transforms = moving([2, 5, 1], [2, 5, 1])  # in any order, with a gap of 3 s
    assert (transforms.pose_at("base", stamp) is not None) == is_known


def test_a_chain_is_composed_in_space():
    """A robot on a slope, with a lidar on a mast that leans the other way."""
    transforms, generator = RigidTransforms(), np.random.default_rng(0)
    total = np.eye(4)
    for child, parent in (("laser", "mast"), ("mast", "base"), ("base", "odom"), ("odom", "map")):
        turn, place = Rotation.from_euler("zyx", generator.uniform(-0.2, 0.2, 3)), generator.normal(size=3)
        transforms.add(child, parent, 5.0, tuple(place), tuple(turn.as_quat()), is_static=child != "base")
        edge = np.eye(4)
        edge[:3, :3], edge[:3, 3] = turn.as_matrix(), place
        total = edge @ total
    found = transforms.pose_at("/laser", 6.0)
    assert (found.x, found.y) == pytest.approx(total[:2, 3])
    assert found.heading == pytest.approx(math.atan2(total[1, 0], total[0, 0]))
    assert not found.is_upside_down
    assert transforms.root("laser") == "map"


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_a_lidar_may_hang_upside_down(yaw):
    transforms = RigidTransforms()
    mount = Rotation.from_euler("z", yaw) * Rotation.from_euler("x", math.pi)
    transforms.add("laser", "base_link", 0.0, (0.2, 0.0, 1.0), tuple(mount.as_quat()), is_static=True)
    transforms.add("base_link", "odom", 1.0, (3.0, 0.0, 0.0), (0, 0, math.sqrt(0.5), math.sqrt(0.5)))
    found = transforms.pose_at("laser", 1.0)
    assert found.is_upside_down
    heading = (yaw + math.pi / 2 + math.pi) % (2 * math.pi) - math.pi
    assert (found.x, found.y, found.heading) == pytest.approx((3.0, 0.2, heading))


def test_a_tilted_lidar_is_refused():
    transforms = RigidTransforms()
    optical = tuple(Rotation.from_euler("zyx", [-90, 0, -90], degrees=True).as_quat())
    transforms.add("camera", "base_link", 0.0, (0.0, 0.0, 1.0), optical, is_static=True)
    transforms.add("base_link", "odom", 1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="camera is tilted by 90 degrees: expected a horizontal lidar, within 30"):
        transforms.pose_at("camera", 1.0)


def test_without_poses_of_the_robot_there_is_no_pose():
    """A tree with static transforms only tells where the lidar is mounted, not where the robot is."""
    transforms = Transforms()
    transforms.add("laser", "base_link", 0.0, (0.2, 0.0, 0.0), is_static=True)
    assert transforms.pose_at("laser", 5.0) is None
    assert not transforms.has_later("laser", 5.0)
    transforms.add("base_link", "odom", 5.0, (1.0, 0.0, 0.0))
    assert transforms.pose_at("laser", 5.0) == pytest.approx((1.2, 0, 0))


def test_one_single_pose_does_not_hold_while_the_robot_drives():
    transforms = moving([5.0], [1.0])
    transforms.add("laser", "base", 0.0, (0.2, 0.0, 0.0), is_static=True)
    assert transforms.pose_at("laser", 6.9) is not None
    assert transforms.pose_at("laser", 9.0) is None
    assert "one single pose of base: for a lidar that stands, set" in str(transforms.why_unplaced("laser", 9.0))
    transforms.add("odom", "map", 5.0, (0.0, 0.0, 0.0))
    assert transforms.pose_at("laser", 9.0) is None
    moving([5.5], [1.0], transforms=transforms)
    assert transforms.pose_at("laser", 9.0) is not None, "two equal poses are those of a robot that stands"


def test_another_static_pose_of_a_frame_is_named():
    transforms = Transforms()
    for place in (0.2, 0.2001, 0.5):
        assert not transforms.left_out
        transforms.add("laser", "base", 0.0, (place, 0.0, 0.0), is_static=True)
    assert next(iter(transforms.left_out)).startswith(
        "laser has several static poses, in base and base: the last holds"
    )


def test_poses_in_a_second_parent_are_left_out():
    transforms = Transforms()
    for step in range(4):
        transforms.add("base", "odom", step, (1.0 + step, 0.0, 0.0))
        transforms.add("base", "odom_combined", step + 0.5, (90.0, 0.0, 0.0))
    assert [transforms.pose_at("base", stamp)[0] for stamp in (0, 0.5, 1, 2.5)] == pytest.approx([1, 1.5, 2, 3.5])
    assert list(transforms.left_out) == ["poses of base in odom_combined are left out: it has poses in odom"]


@pytest.mark.parametrize(
    ("rotation", "problem"),
    [((0, 0, math.nan, 1), "they are not finite")]
    + [
        (rotation, "a rotation is a quaternion of length")
        for rotation in ((0, 0, 0, 0), (0, 0, 0, 6.9e-310), (0, 0, 0, 1e200), (1e200, 0, 0, 1e200), (0, 0, 0.5, 0.5))
    ],
)
@pytest.mark.parametrize("is_static", [True, False])
def test_poses_of_uninitialized_messages_are_left_out(rotation, problem, is_static):
    transforms = RigidTransforms()
    transforms.add("base", "odom", 0.0, (1.0, 0.0, 0.0), tuple(map(float, rotation)), is_static=is_static)
    assert not transforms.edges
    (message,) = transforms.left_out
    assert message.startswith(f"poses of base are left out: {problem}")


@pytest.mark.parametrize("parent", ["odom", "base_footprint"])
def test_poses_that_change_replace_a_static_one(parent):
    transforms = Transforms()
    for _ in range(2):
        transforms.add("base", parent, 0.0, (9.0, 0.0, 0.0), is_static=True)
        moving([5.0, 6.0], [5.0, 6.0], transforms=transforms)
    transforms.add("base", parent, 0.0, (9.0, 0.0, 0.0), is_static=True)
    assert transforms.pose_at("base", 5.5) == pytest.approx((5.5, 0, 0))
    assert not transforms.left_out


def test_a_mounting_is_on_the_robot_of_its_namespace_or_on_the_only_frame_that_moves():
    transforms = Transforms(mounting=(0.2, 0.0, 0.0))
    assert transforms.pose_at("laser", 1.0) is None
    transforms.add("arm", "robot", 1.0, (9.0, 9.0, 0.0), is_static=True)
    moving([1.0, 2.0], [1.0, 2.0], "robot", "odom", transforms)
    assert transforms.pose_at("laser", 1.5) == pytest.approx((1.7, 0, 0))
    moving([1.0, 2.0], [3.0, 4.0], "r1/base_link", "map", transforms)
    assert transforms.pose_at("/r1/laser", 1.5) == pytest.approx((3.7, 0, 0))
    assert transforms.pose_at("laser", 1.5) is None, "it could be on either"
    transforms.mounting = None
    assert transforms.pose_at("r1/laser", 1.5) is None, "a lidar is nowhere without transform and mounting"


def test_a_cycle_ends():
    transforms = moving([1.0], [1.0], "b", "a", moving([1.0], [1.0], "a", "b"))
    assert transforms.pose_at("a", 1.0) == pytest.approx((2, 0, 0))


def test_a_pose_is_final_once_a_later_one_is_known():
    transforms = moving([6.0], [0.0])
    transforms.add("laser", "base", 0.0, (0.2, 0.0, 0.0), is_static=True)
    assert not transforms.has_later("laser", 5.0), "one pose could be a static transform"
    moving([7.0], [0.0], transforms=transforms)
    assert transforms.has_later("laser", 7.0)
    assert not transforms.has_later("laser", 7.01)


def test_why_a_frame_has_no_pose():
    transforms = Transforms()
    assert transforms.why_unplaced("/laser", 1.0).startswith("no transform of laser: set prediction.mounting")
    transforms.add("laser", "base", 0.0, (0, 0, 0), is_static=True)
    assert transforms.why_unplaced("/laser", 1.0) == "base, above laser, has no poses; there are no poses"
    transforms.add("base_link", "odom", 0.0, (0, 0, 0))
    assert transforms.why_unplaced("laser", 1.0).endswith("has no poses; the poses are of base_link in odom")
    moving([0.0, 0.5], [0, 1], transforms=transforms)
    assert transforms.pose_at("laser", 1.0) is None
    known = "1.00 s, at most 2 s apart; there are poses from 0.00 to 0.50 s"
    assert transforms.why_unplaced("laser", 1.0).endswith(known)
    assert transforms.why_unplaced("laser", 0.2) is None


def test_a_rare_correction_is_no_reason_for_a_missing_pose():
    transforms = Transforms()
    transforms.add("laser", "base_link", 0.0, (0, 0, 0), is_static=True)
    moving([0.0, 0.5], [0.0, 1.0], "odom", "map", transforms)  # its first poses arrive before those of the odometry
    moving([5.0, 5.5], [0.0, 1.0], "base_link", "odom", transforms)
    assert transforms.why_unplaced("laser", 5.2) is None
    assert "it needs poses of base_link in odom" in str(transforms.why_unplaced("laser", 8.0))


def test_a_pose_is_missing_only_where_the_frame_moved_in_a_gap():
    """Odometry that is silent while the robot stands, for 5 s, and then loses 5 s of its way."""
    transforms = moving([0, 1, 6, 7, 12], [0, 1, 1, 2, 9])
    assert transforms.pose_at("base", 3.0) == pytest.approx((1, 0, 0))
    assert transforms.pose_at("base", 6.5) == pytest.approx((1.5, 0, 0))
    assert transforms.pose_at("base", 9.0) is None


@pytest.mark.parametrize("stamps", [(0.0, 0.1), (0.0, 2.0, 4.0, 6.0, 8.0)])
def test_a_localization_that_is_rare_or_silent_keeps_its_last_correction(stamps):
    transforms = moving(0.1 * np.arange(100), 0.1 * np.arange(100))
    moving(stamps, [0.5 * number for number in range(len(stamps))], "odom", "map", transforms)
    last = max(number for number, stamp in enumerate(stamps) if stamp <= 5.05)
    assert transforms.pose_at("base", 5.05) == pytest.approx((5.05 + 0.5 * last, 0, 0))
    assert transforms.has_later("base", 5.05), "no more corrections are expected"


def test_a_publisher_of_ros_1_that_repeats_a_mounting_each_second_holds_between():
    transforms = moving(0.1 * np.arange(100), 0.1 * np.arange(100))
    moving(1.0000001 * np.arange(1, 4), [0.2] * 3, "laser", "base", transforms)
    for stamp in (0.05, 2.5, 8.05):
        assert transforms.pose_at("laser", stamp) == pytest.approx((stamp + 0.2, 0, 0))


def test_poses_may_be_taken_in_a_lower_frame():
    transforms = Transforms(frame="odom")
    moving([1.0, 2.0], [5.0, 6.0], transforms=transforms)
    moving([1.0, 2.0], [50.0, 60.0], "odom", "map", transforms)
    assert transforms.pose_at("base", 1.5) == pytest.approx((5.5, 0, 0))
    assert transforms.root("base") == "odom"
    transforms.frame = "earth"
    assert transforms.pose_at("base", 1.5) is None
    assert transforms.why_unplaced("base", 1.5) == "the frame earth is not above base, but odom, map"


@pytest.mark.parametrize("given", [{"mounting": (0.2, 0.0, math.pi)}, {"pose": (5.7, 0.0, math.pi)}])
@pytest.mark.parametrize("is_upside_down", [False, True])
def test_a_given_pose_or_mounting_replaces_the_transforms_but_not_its_upside_down(given, is_upside_down):
    transforms = RigidTransforms(**given)
    turn = tuple(Rotation.from_euler("zx", [2.0, math.pi * is_upside_down]).as_quat())
    transforms.add("laser", "base_link", 0.0, (9.0, 9.0, 1.0), turn, is_static=True)
    for stamp in (1.0, 2.0):
        transforms.add("base_link", "odom", stamp, (4.0 + stamp, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    found = transforms.pose_at("laser", 1.5)
    assert (found.x, found.y, abs(found.heading)) == pytest.approx((5.7, 0, math.pi))
    assert found.is_upside_down == is_upside_down
