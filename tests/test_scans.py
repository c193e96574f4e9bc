import numpy as np
import pytest
import torch

from repro.scans import Scans


def window(steps=5, beams=4):
    rng = np.random.default_rng(0)
    return Scans(rng.random((steps, beams)), np.linspace(-1, 1, beams), rng.random((steps, 3)))


@pytest.mark.parametrize(
    ("ranges", "angles", "poses"),
    [
        ((5, 4), (3,), (5, 3)),
        ((5, 4), (4,), (6, 3)),
        ((5, 4), (4,), (5, 2)),
        ((2, 5, 4), (4,), (5, 3)),
        ((4,), (4,), (3,)),
    ],
)
def test_shapes_that_disagree_are_refused_naming_them(ranges, angles, poses):
    with pytest.raises(ValueError, match=r"expected ranges \(B, T, N\), .* got") as caught:
        Scans(np.zeros(ranges), np.zeros(angles), np.zeros(poses))
    assert f"got {ranges}, {angles}, {poses}" in str(caught.value)


def test_arrays_and_tensors_are_not_mixed_and_hold_real_numbers():
    arrays = window()
    with pytest.raises(ValueError, match="as arrays, or all of them as tensors, got both"):
        Scans(torch.as_tensor(arrays.ranges), arrays.angles, arrays.poses)
    for dtype in (torch.bool, torch.complex64):
        with pytest.raises(ValueError, match=f"ranges: expected real numbers, got {dtype}"):
            Scans(torch.ones(5, 4, dtype=dtype), torch.zeros(4), torch.zeros(5, 3))


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
    tensors, is_hit = scans.tensors(dtype=torch.float64).points()
    np.testing.assert_array_equal(tensors[0], points)
    np.testing.assert_array_equal(is_hit[0], hit)


def test_tensors_are_a_batch_in_float32():
    for scans in (window(), Scans.stack([window()])):
        tensors = scans.tensors()
        assert tensors.ranges.shape == (1, 5, 4)
        assert tensors.poses.shape == (1, 5, 3)
        assert tensors.angles.dtype == torch.float32
