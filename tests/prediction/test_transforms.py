"""Poses composed and interpolated, compared with matrices."""

import math

import numpy as np
import pytest

from repro.prediction.transforms import Transforms


def matrix(pose) -> np.ndarray:
    x, y, heading = pose
    return np.array([[math.cos(heading), -math.sin(heading), x], [math.sin(heading), math.cos(heading), y], [0, 0, 1]])


def test_a_chain_of_frames_is_composed():
    transforms = Transforms()
    chain = [("laser", "base", (0.2, 0.1, 3.0)), ("base", "odom", (4.0, -2.0, 1.2)), ("odom", "map", (-7.0, 3.0, -2.1))]
    for child, parent, pose in chain:
        transforms.add(child, parent, 5.0, pose, is_static=True)
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


def test_a_frame_that_nobody_places_is_at_the_frame_with_most_poses():
    transforms = Transforms()
    assert transforms.pose_at("laser", 1.0) is None
    transforms.add("arm", "base", 1.0, (9.0, 9.0, 0.0), is_static=True)
    for stamp in (1.0, 2.0):
        transforms.add("base", "odom", stamp, (stamp, 0.0, 0.0))
    assert transforms.pose_at("laser", 1.5) == pytest.approx((1.5, 0, 0))
    assert "laser" not in transforms
    assert "/base" in transforms


def test_a_frame_that_nobody_places_is_at_the_robot_and_not_on_a_wheel():
    transforms = Transforms()
    for number in range(10):
        transforms.add("wheel", "base_link", 0.1 * number, (0.2, 0.3, 5.0 * number))
    for number in range(3):
        transforms.add("base_link", "odom", 0.5 * number, (1.0, 2.0, 0.1))
    assert transforms.pose_at("laser", 0.5) == pytest.approx((1.0, 2.0, 0.1))


def test_a_cycle_ends():
    transforms = Transforms()
    transforms.add("a", "b", 1.0, (1.0, 0.0, 0.0))
    transforms.add("b", "a", 1.0, (1.0, 0.0, 0.0))
    assert transforms.pose_at("a", 1.0) == pytest.approx((2, 0, 0))


def test_a_pose_is_final_once_a_later_one_is_known():
    transforms = Transforms()
    transforms.add("laser", "base", 0.0, (0.2, 0.0, 0.0), is_static=True)
    assert transforms.has_later("laser", 5.0)
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
