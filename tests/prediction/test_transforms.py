"""Poses composed and interpolated, compared with matrices."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from repro.prediction.transforms import Transforms as RigidTransforms
from repro.prediction.transforms import without_transform


class Transforms(RigidTransforms):
    """Transforms with planar poses, x, y and heading."""

    def add(self, child, parent, stamp, pose, *, is_static=False) -> None:
        x, y, heading = pose
        turn = (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
        super().add(child, parent, stamp, (x, y, 0.0), turn, is_static=is_static)

    def pose_at(self, frame, stamp):
        found = super().pose_at(frame, stamp)
        return found and (found.x, found.y, found.heading)


def matrix(pose) -> np.ndarray:
    x, y, heading = pose
    return np.array([[math.cos(heading), -math.sin(heading), x], [math.sin(heading), math.cos(heading), y], [0, 0, 1]])


def test_a_chain_of_frames_is_composed():
    transforms = Transforms()
    chain = [("laser", "base", (0.2, 0.1, 3.0)), ("base", "odom", (4.0, -2.0, 1.2)), ("odom", "map", (-7.0, 3.0, -2.1))]
    for child, parent, pose in chain:
        transforms.add(child, parent, 5.0, pose, is_static=child != "base")
    x, y, heading = transforms.pose_at("/laser", 8.0)
    expected = matrix(chain[2][2]) @ matrix(chain[1][2]) @ matrix(chain[0][2])
    assert matrix((x, y, heading)) == pytest.approx(expected)
    assert transforms.root("laser") == "map"


def test_headings_are_interpolated_through_the_shorter_turn():
    transforms = Transforms()
    transforms.add("base", "odom", 1.0, (0.0, 0.0, math.pi - 0.1))
    transforms.add("base", "odom", 2.0, (1.0, 2.0, -math.pi + 0.1))
    x, y, heading = transforms.pose_at("base", 1.25)
    assert (x, y) == pytest.approx((0.25, 0.5))
    assert heading == pytest.approx(math.pi - 0.05)


def test_poses_may_arrive_in_any_order():
    transforms = Transforms()
    for stamp in (3.0, 1.0, 2.0):
        transforms.add("base", "odom", stamp, (stamp, 0.0, 0.0))
    assert [transforms.pose_at("base", stamp)[0] for stamp in (1.0, 1.5, 2.5, 3.0)] == pytest.approx([1, 1.5, 2.5, 3])


@pytest.mark.parametrize(("stamp", "is_known"), [(0.85, False), (0.95, True), (1.5, True), (3.0, False), (4.15, False)])
def test_poses_are_known_near_others_only(stamp, is_known):
    transforms = Transforms()
    for time in (1.0, 2.0, 4.0):  # a gap of 2 s
        transforms.add("base", "odom", time, (time, 0.0, 0.0))
    assert (transforms.pose_at("base", stamp) is not None) == is_known


def test_a_chain_is_composed_in_space():
    """A robot on a slope, with a lidar on a mast that leans the other way."""
    transforms, generator = RigidTransforms(), np.random.default_rng(0)
    total = np.eye(4)
    for child, parent in (("laser", "mast"), ("mast", "base"), ("base", "odom")):
        turn, place = Rotation.from_euler("zyx", generator.uniform(-0.2, 0.2, 3)), generator.normal(size=3)
        transforms.add(child, parent, 5.0, tuple(place), tuple(turn.as_quat()), is_static=child != "base")
        edge = np.eye(4)
        edge[:3, :3], edge[:3, 3] = turn.as_matrix(), place
        total = edge @ total
    found = transforms.pose_at("laser", 5.0)
    assert (found.x, found.y) == pytest.approx(total[:2, 3])
    assert found.heading == pytest.approx(math.atan2(total[1, 0], total[0, 0]))
    assert not found.is_upside_down


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_a_lidar_may_hang_upside_down(yaw):
    transforms = RigidTransforms()
    mount = Rotation.from_euler("z", yaw) * Rotation.from_euler("x", math.pi)
    transforms.add("laser", "base_link", 0.0, (0.2, 0.0, 1.0), tuple(mount.as_quat()), is_static=True)
    transforms.add("base_link", "odom", 1.0, (3.0, 0.0, 0.0), (0, 0, math.sqrt(0.5), math.sqrt(0.5)))
    found = transforms.pose_at("laser", 1.0)
    assert found.is_upside_down
    assert (found.x, found.y, found.heading) == pytest.approx(
        (3.0, 0.2, (yaw + math.pi / 2 + math.pi) % (2 * math.pi) - math.pi)
    )


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


def test_poses_in_a_second_parent_are_left_out():
    transforms = Transforms()
    for step in range(4):
        transforms.add("base", "odom", step, (1.0 + step, 0.0, 0.0))
        transforms.add("base", "odom_combined", step + 0.5, (90.0, 0.0, 0.0))
    assert [transforms.pose_at("base", stamp)[0] for stamp in (0, 0.5, 1, 2.5)] == pytest.approx([1, 1.5, 2, 3.5])
    assert list(transforms.left_out) == ["poses of base in odom_combined are left out: it has poses in odom"]
    transforms.forget()
    transforms.add("base", "odom_combined", 0.0, (90.0, 0.0, 0.0))
    assert transforms.pose_at("base", 0.0) == pytest.approx((90, 0, 0))


@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, math.nan, 1.0)])
def test_poses_without_a_rotation_are_left_out(rotation):
    transforms = RigidTransforms()
    transforms.add("base", "odom", 0.0, (1.0, 0.0, 0.0), rotation)
    assert transforms.pose_at("base", 0.0) is None
    (message,) = transforms.left_out
    assert "poses of base are left out" in message


def test_poses_that_change_replace_a_static_one():
    transforms = Transforms()
    transforms.add("base", "odom", 0.0, (9.0, 0.0, 0.0), is_static=True)
    for stamp in (5.0, 6.0):
        transforms.add("base", "odom", stamp, (stamp, 0.0, 0.0))
    transforms.add("base", "odom", 0.0, (9.0, 0.0, 0.0), is_static=True)
    assert transforms.pose_at("base", 5.5) == pytest.approx((5.5, 0, 0))


def test_a_frame_that_nobody_places_is_at_the_only_frame_that_moves():
    transforms = Transforms()
    assert transforms.pose_at("laser", 1.0) is None
    transforms.add("arm", "robot", 1.0, (9.0, 9.0, 0.0), is_static=True)
    for stamp in (1.0, 2.0):
        transforms.add("robot", "odom", stamp, (stamp, 0.0, 0.0))
    assert transforms.pose_at("laser", 1.5) == pytest.approx((1.5, 0, 0))
    assert "laser" not in transforms
    assert "/robot" in transforms
    transforms.add("wheel", "robot", 1.0, (0.0, 0.0, 0.0))
    assert transforms.pose_at("laser", 1.5) is None, "it could be on the wheel"
    assert "its scans have no poses" in without_transform("laser", transforms.base_of("laser"))


def test_a_frame_that_nobody_places_is_at_the_robot_and_not_on_a_wheel():
    transforms = Transforms()
    for number in range(10):
        transforms.add("r1/wheel", "r1/base_link", 0.1 * number, (0.2, 0.3, 5.0 * number))
    for number in range(3):
        transforms.add("r1/base_link", "odom", 0.5 * number, (1.0, 2.0, 0.1))
    assert transforms.pose_at("r1/laser", 0.5) == pytest.approx((1.0, 2.0, 0.1))
    assert transforms.pose_at("laser", 0.5) == pytest.approx((1.0, 2.0, 0.1))
    assert "of the robot, r1/base_link" in without_transform("laser", transforms.base_of("laser"))


def test_of_several_robots_the_lidar_is_on_that_of_its_namespace():
    transforms = Transforms()
    for name, x in (("r1", 1.0), ("r2", 2.0)):
        transforms.add(f"{name}/base_link", "map", 0.0, (x, 0.0, 0.0))
    assert transforms.pose_at("r2/laser", 0.0) == pytest.approx((2, 0, 0))
    assert transforms.pose_at("laser", 0.0) is None


def test_a_cycle_ends():
    transforms = Transforms()
    transforms.add("a", "b", 1.0, (1.0, 0.0, 0.0))
    transforms.add("b", "a", 1.0, (1.0, 0.0, 0.0))
    assert transforms.pose_at("a", 1.0) == pytest.approx((2, 0, 0))


def test_a_pose_is_final_once_a_later_one_is_known():
    transforms = Transforms()
    transforms.add("laser", "base", 0.0, (0.2, 0.0, 0.0), is_static=True)
    transforms.add("base", "odom", 6.0, (0.0, 0.0, 0.0))
    assert not transforms.has_later("laser", 5.0), "one pose could be a static transform"
    transforms.add("base", "odom", 7.0, (0.0, 0.0, 0.0))
    assert transforms.has_later("laser", 7.0)
    assert not transforms.has_later("laser", 7.01)


def test_old_poses_are_forgotten():
    transforms = Transforms(keep_s=2.0)
    for step in range(10_000):
        transforms.add("base", "odom", 0.01 * step, (step, 0.0, 0.0))
    assert 200 <= len(transforms.edges["base"].stamps) <= 402
    assert transforms.pose_at("base", 99.99 - 1.9) is not None
    assert transforms.pose_at("base", 50.0) is None


def test_why_a_frame_has_no_pose():
    transforms = Transforms()
    transforms.add("laser", "base", 0.0, (0, 0, 0), is_static=True)
    assert transforms.why_unplaced("/laser", 1.0) == "base, above laser, has no poses; there are no poses"
    transforms.add("base_link", "odom", 0.0, (0, 0, 0))
    assert transforms.why_unplaced("laser", 1.0).endswith("has no poses; the poses are of base_link in odom")
    transforms.add("base", "odom", 0.0, (0, 0, 0))
    transforms.add("base", "odom", 0.5, (1, 0, 0))
    assert transforms.pose_at("laser", 1.0) is None
    assert transforms.why_unplaced("laser", 1.0).endswith(
        "1.00 s, at most 1 s apart; there are poses from 0.00 to 0.50 s"
    )
    transforms.forget()
    assert transforms.why_unplaced("laser", 1.0).endswith("there are none yet")


def moving(stamps, xs, child="base", parent="odom", transforms=None) -> Transforms:
    transforms = transforms or Transforms()
    for stamp, x in zip(stamps, xs, strict=True):
        transforms.add(child, parent, stamp, (x, 0.0, 0.0))
    return transforms


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
    transforms.note_scan(10.0)
    transforms.note_scan(20.0)
    assert transforms.has_later("base", 5.05) == (stamps[-1] >= 5.05)
    assert transforms.has_later("base", 5.05, silent_s=5.0), "no more poses are expected"


def test_a_publisher_of_ros_1_that_repeats_a_mounting_each_second_holds_between():
    transforms = moving(0.1 * np.arange(100), 0.1 * np.arange(100))
    moving(1.0000001 * np.arange(1, 4), [0.2] * 3, "laser", "base", transforms)
    for stamp in (0.05, 2.5, 8.05):
        assert transforms.pose_at("laser", stamp) == pytest.approx((stamp + 0.2, 0, 0))


@pytest.mark.parametrize("is_static_first", [True, False])
def test_odometry_of_a_frame_below_a_static_one_places_both(is_static_first):
    transforms = Transforms()
    static = ("base_link", "base_footprint", 0.0, (0.3, 0.0, 0.0))
    if is_static_first:
        transforms.add(*static, is_static=True)
    moving([1.0, 2.0], [5.0, 6.0], "base_link", "odom", transforms)
    if not is_static_first:
        transforms.add(*static, is_static=True)
    transforms.add(*static, is_static=True)
    assert transforms.pose_at("base_link", 1.5) == pytest.approx((5.5, 0, 0))
    assert transforms.pose_at("base_footprint", 1.5) == pytest.approx((5.2, 0, 0))
    assert not transforms.left_out


def test_poses_may_be_taken_in_a_lower_frame():
    transforms = Transforms(frame="odom")
    moving([1.0, 2.0], [5.0, 6.0], transforms=transforms)
    moving([1.0, 2.0], [50.0, 60.0], "odom", "map", transforms)
    assert transforms.pose_at("base", 1.5) == pytest.approx((5.5, 0, 0))
    assert transforms.root("base") == "odom"
    transforms.frame = "earth"
    assert transforms.pose_at("base", 1.5) is None
    assert transforms.why_unplaced("base", 1.5) == "the frame earth is not above base, but odom, map"


def test_a_mounting_replaces_the_transforms_of_the_lidar():
    transforms = Transforms(mounting=(0.2, 0.0, math.pi))
    transforms.add("laser", "base_link", 0.0, (9.0, 9.0, 0.0), is_static=True)
    moving([1.0, 2.0], [5.0, 6.0], "base_link", "odom", transforms)
    x, y, heading = transforms.pose_at("laser", 1.5)
    assert (x, y, abs(heading)) == pytest.approx((5.7, 0, math.pi))


@pytest.mark.parametrize("given", [{"mounting": (0.2, 0.0, 0.0)}, {"pose": (5.7, 0.0, 0.0)}])
@pytest.mark.parametrize("is_upside_down", [False, True])
def test_transforms_tell_that_a_lidar_with_a_given_pose_or_mounting_hangs_upside_down(given, is_upside_down):
    transforms = RigidTransforms(**given)
    turn = tuple(Rotation.from_euler("zx", [2.0, math.pi * is_upside_down]).as_quat())
    transforms.add("laser", "base_link", 0.0, (9.0, 9.0, 1.0), turn, is_static=True)
    for stamp in (1.0, 2.0):
        transforms.add("base_link", "odom", stamp, (4.0 + stamp, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert "laser" in transforms
    found = transforms.pose_at("laser", 1.5)
    assert (found.x, found.y, found.heading) == pytest.approx((5.7, 0, 0))
    assert found.is_upside_down == is_upside_down


@pytest.mark.parametrize("rotation", [(0, 0, 0, 6.9e-310), (0, 0, 0, 1e200), (1e200, 0, 0, 1e200), (0, 0, 0.5, 0.5)])
@pytest.mark.parametrize("is_static", [True, False])
def test_rotations_of_uninitialized_messages_are_left_out(rotation, is_static):
    transforms = RigidTransforms()
    transforms.add("base", "odom", 0.0, (1.0, 0.0, 0.0), tuple(map(float, rotation)), is_static=is_static)
    assert not transforms.edges
    (message,) = transforms.left_out
    assert message.startswith("poses of base are left out: a rotation is a quaternion of length")


def test_a_frozen_clock_and_made_up_frames_do_not_fill_the_memory():
    transforms = Transforms(keep_s=30.0)
    moving([5.0] * 3000, range(3000), transforms=transforms)
    assert len(transforms.edges["base"].stamps) == 1
    for number in range(2000):
        transforms.add(f"frame{number}", "odom", 0.0, (0.0, 0.0, 0.0))
    assert len(transforms.edges) == 1000
    assert len(transforms.left_out) == 1
