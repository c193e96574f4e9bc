import math

import numpy as np
import pytest
import torch

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.recordings.reader import read_shards
from repro.scans import Scans


def slow_projection(ranges, angles, poses, size_px, decay, oldest_gray):
    """Compute the projection step by step: oldest scan first, every hit painted over older ones."""
    image = np.full((size_px, size_px), 255, dtype=np.uint8)
    steps = len(ranges)
    for step in range(steps):
        x, y, heading = poses[step]
        gray = oldest_gray * (1 - step / (steps - 1)) if decay else 0.0
        for distance, angle in zip(ranges[step], angles, strict=True):
            if not np.isfinite(distance):
                continue
            column = math.floor((x + distance * math.cos(heading + angle)) / 50 * size_px)
            row = size_px - 1 - math.floor((y + distance * math.sin(heading + angle)) / 50 * size_px)
            if 0 <= row < size_px and 0 <= column < size_px:
                image[row, column] = round(255 * gray)
    return image


@pytest.fixture(scope="module")
def shard(recorded):
    return next(read_shards(recorded, "test"))


def project(scans, grid, **parameters):
    """Compute the projection (B, H, W) of scans."""
    return Projection(**parameters).encode(scans, grid)[:, 0]


@pytest.mark.parametrize("decay", [True, False])
@pytest.mark.parametrize("size_px", [32, 100])
def test_the_projection_agrees_with_a_slow_reference(shard, size_px, decay):
    images = project(shard.scans.tensors(dtype=torch.float64), Grid(size_px, 50.0), decay=decay)
    for image, ranges, poses in zip(images, shard.scans.ranges, shard.scans.poses, strict=True):
        reference = slow_projection(ranges.astype(float), shard.scans.angles, poses, size_px, decay, 0.8)
        assert np.abs(image.numpy().astype(int) - reference).max() <= 1


def test_float32_changes_hardly_a_pixel(shard):
    exact = project(shard.scans.tensors(dtype=torch.float64), Grid(64, 50.0))
    single = project(shard.scans.tensors(), Grid(64, 50.0))
    assert (exact != single).float().mean() < 1e-4


def one_beam(hits):
    """Scans of one beam straight ahead from the map's center."""
    ranges = torch.tensor(hits, dtype=torch.float32)[None, :, None]
    poses = torch.tensor([[25.0, 25.0, 0.0]]).expand(1, len(hits), 3)
    return Scans(ranges, torch.zeros(1), poses)


def test_the_newest_reading_wins():
    image = project(one_beam([10.0, 20.0, 10.0]), Grid(50, 50.0), oldest_gray=0.8)[0]
    row = 24
    assert image[row, 35] == 0  # hit first and last
    assert image[row, 45] == round(255 * 0.4)  # hit in the middle
    assert (image < 255).sum() == 2


def test_gray_falls_linearly_from_the_oldest_to_the_newest():
    scans = one_beam([2.0 * step for step in range(1, 11)])
    shades = project(scans, Grid(50, 50.0), oldest_gray=0.9)[0, 24, 27::2][:10]
    assert shades.tolist() == pytest.approx([255 * 0.9 * (1 - k / 9) for k in range(10)], abs=0.51)


def test_the_newest_hit_is_black_in_a_window_of_any_length():
    for steps in (1, 2, 7):
        assert project(one_beam([10.0] * steps), Grid(50, 50.0), oldest_gray=0.8).min() == 0


def test_without_decay_every_hit_is_black():
    image = project(one_beam([5.0, 10.0, torch.inf, 20.0]), Grid(50, 50.0), decay=False)
    assert sorted(image.unique().tolist()) == [0, 255]
    assert (image == 0).sum() == 3


def test_misses_and_hits_off_the_map_are_not_drawn():
    assert (project(one_beam([torch.inf, 26.0, 40.0]), Grid(50, 50.0)) == 255).all()


def test_rotating_the_poses_rotates_the_image(shard):
    scans = shard.scans.tensors(dtype=torch.float64)
    turned = scans.poses.clone()
    centerd = scans.poses[..., :2] - 25
    turned[..., 0], turned[..., 1] = 25 - centerd[..., 1], 25 + centerd[..., 0]
    turned[..., 2] += math.pi / 2
    image = project(scans, Grid(64, 50.0))
    again = project(Scans(scans.ranges, scans.angles, turned), Grid(64, 50.0))
    assert (again != torch.rot90(image, 1, dims=(1, 2))).float().mean() < 1e-3


def test_invalid_grays_are_refused():
    with pytest.raises(ValueError, match=r"oldest_gray\n.*less than or equal to 0.996"):
        Projection(oldest_gray=1.0)


def test_the_input_of_a_network_is_in_0_to_1():
    images = torch.tensor([[[[0, 51], [204, 255]]]], dtype=torch.uint8)
    assert Projection().to_input(images).flatten().tolist() == pytest.approx([0, 0.2, 0.8, 1])
