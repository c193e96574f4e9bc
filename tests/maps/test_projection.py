import math

import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.recordings.reader import open_recordings
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
    return next(open_recordings(recorded).shards("test"))


def project(scans, grid, **parameters):
    """Compute the projection (B, H, W) of scans."""
    return Projection(**parameters).encode(scans, grid)[:, 0]


@pytest.mark.parametrize("decay", [True, False])
@pytest.mark.parametrize("size_px", [32, 100])
def test_the_projection_agrees_with_a_slow_reference(shard, size_px, decay):
    images = project(shard.scans.batched(np.float64), Grid(size_px, 50.0), decay=decay)
    for image, ranges, poses in zip(images, shard.scans.ranges, shard.scans.poses, strict=True):
        reference = slow_projection(ranges.astype(float), shard.scans.angles, poses, size_px, decay, 0.8)
        assert np.abs(image.astype(int) - reference).max() <= 1


def test_float32_changes_hardly_a_pixel(shard):
    exact = project(shard.scans.batched(np.float64), Grid(64, 50.0))
    single = project(shard.scans.batched(), Grid(64, 50.0))
    assert (exact != single).mean() < 1e-4


def one_beam(hits):
    """Scans of one beam straight ahead from the map's center."""
    return Scans(np.array(hits)[:, None], np.zeros(1), np.tile([25.0, 25.0, 0.0], (len(hits), 1))).batched()


def test_the_newest_reading_wins():
    image = project(one_beam([10.0, 20.0, 10.0]), Grid(50, 50.0), oldest_gray=0.8)[0]
    row = 24
    assert image[row, 35] == 0  # hit first and last
    assert image[row, 45] == round(255 * 0.4)  # hit in the middle
    assert (image < 255).sum() == 2
