"""Rotations and poses against SciPy."""

import numpy as np
from scipy.spatial import transform

from repro.logs.rotations import UPSIDE_DOWN, RigidTransform, Rotation


def test_rotations_and_poses_are_those_of_scipy():
    rng = np.random.default_rng(0)
    for _ in range(100):
        (quaternions, places), (share, heading) = (rng.normal(size=(2, n)) for n in (4, 3)), rng.random(2)
        one, other = map(Rotation.from_quat, quaternions)
        first, second = map(transform.Rotation.from_quat, quaternions)
        between = transform.Slerp([0, 1], transform.Rotation.concatenate([first, second]))(share)
        pose = RigidTransform.from_components(places[0], one) * RigidTransform.from_components(places[1], other)
        make = transform.RigidTransform.from_components
        expected = make(places[0], first) * make(places[1], second)
        np.testing.assert_allclose(pose.translation, expected.translation)
        for found, known in [
            (one * other, first * second),
            (one.toward(other, share), between),
            (pose.rotation, expected.rotation),
            (Rotation.about_z(heading) * UPSIDE_DOWN, transform.Rotation.from_euler("ZX", [heading, np.pi])),
        ]:
            np.testing.assert_allclose(found.as_matrix(), known.as_matrix(), atol=1e-9)


def test_the_angle_between_rotations_is_that_of_scipy():
    rng = np.random.default_rng(1)
    for quaternions in rng.normal(size=(50, 2, 4)):
        (one, other), (first, second) = (map(kind.from_quat, quaternions) for kind in (Rotation, transform.Rotation))
        assert np.isclose((one.inv() * other).magnitude(), (first.inv() * second).magnitude())
