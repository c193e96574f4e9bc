import re

import numpy as np
import pytest

from repro.scans import Scans


def window(steps=5, beams=4):
    rng = np.random.default_rng(0)
    return Scans(rng.random((steps, beams)), np.linspace(-1, 1, beams), rng.random((steps, 3)))


SHAPES = (((5, 4), (3,), (5, 3)), ((5, 4), (4,), (6, 3)), ((2, 5, 4), (4,), (5, 3)), ((0, 4), (4,), (0, 3)))
RANGES, ANGLES, POSES = (getattr(window(), name) for name in ("ranges", "angles", "poses"))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        *(([*map(np.zeros, shapes)], ".*".join(map(re.escape, map(str, shapes)))) for shapes in SHAPES),
        ((np.ma.masked_greater(RANGES, 0.5), ANGLES, POSES), "ranges: expected a plain array .*, got a masked one"),
        ((RANGES.astype(str), ANGLES, POSES), "ranges: expected floating-point numbers"),
        ((RANGES, ANGLES + 0j, POSES), "angles: expected real numbers, got complex128"),
        ((RANGES, ANGLES, [[0.0, 0.0, 0.0], [1.0]]), "poses: expected an array of real numbers, got list"),
        ((RANGES > 0, ANGLES, POSES), "ranges: expected floating-point numbers, got bool"),
        ((RANGES.astype(int), ANGLES, POSES), "ranges: expected floating-point numbers, got int64"),
        ((RANGES, ANGLES, POSES.astype("m8[s]")), r"poses: expected real numbers, got timedelta64\[s\]"),
    ],
)
def test_arrays_of_other_kinds_and_shapes_are_refused(arrays, message):
    with pytest.raises(ValueError, match=message):
        Scans(*arrays)


def test_windows_with_different_angles_are_not_stacked():
    with pytest.raises(ValueError, match="same beam angles"):
        Scans.stack([window(), Scans(RANGES, 2 * ANGLES, POSES)])


def test_windows_are_stacked_and_indexed():
    first, second = window(), window()
    batch = Scans.stack([first, second])
    assert (len(first), len(batch)) == (1, 2)
    assert np.array_equal(batch[1].ranges, second.ranges)
    assert len(batch[:1]) == 1
    assert np.array_equal(batch[:1].poses[0], first.poses)


def test_points_are_where_the_beams_end():
    ranges = np.array([[2.0, np.inf, np.nan]])
    scans = Scans(ranges, np.array([-np.pi / 2, 0.0, np.pi / 2]), np.array([[1.0, 5.0, np.pi / 2]]))
    points, hit = scans.points()
    assert hit.tolist() == [[True, False, False]]
    np.testing.assert_allclose(points, [[[3, 5], [1, 5], [1, 5]]], atol=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.longdouble, ">f4"])
def test_a_batch_has_one_type_and_rising_angles(dtype):
    falling = Scans(RANGES[:, ::-1].astype(dtype), 3 * ANGLES[::-1].astype(dtype), POSES)
    for scans in (falling, Scans.stack([falling])):
        batch = scans.batched()
        assert (batch.ranges.shape, batch.poses.shape) == ((1, 5, 4), (1, 5, 3))
        assert {array.dtype for array in vars(batch).values()} == {np.dtype(np.float32)}
        assert np.array_equal(batch.ranges[0], RANGES.astype(dtype).astype(np.float32))
        assert np.array_equal(batch.angles, (3 * ANGLES.astype(dtype)).astype(np.float32))
