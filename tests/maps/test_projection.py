import math

import numpy as np
import pytest
import torch
from shapely import affinity, contains_xy
from shapely.geometry import Polygon

from repro.maps.grid import Grid
from repro.maps.projection import project, rasterize
from repro.simulation.store import read_shards


def slow_projection(ranges, angles, poses, size_px, decay, lightest):
    """The projection as one would explain it: oldest scan first, every hit painted over what is there."""
    image = np.full((size_px, size_px), 255, dtype=np.uint8)
    steps = len(ranges)
    for step in range(steps):
        x, y, heading = poses[step]
        gray = lightest * (1 - step / (steps - 1)) if decay else 0.0
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


def tensors(shard, dtype=torch.float64):
    return (torch.as_tensor(shard[name]).to(dtype) for name in ("ranges", "angles", "poses"))


@pytest.mark.parametrize("decay", [True, False])
@pytest.mark.parametrize("size_px", [32, 100])
def test_agrees_with_the_slow_reference(shard, size_px, decay):
    images = project(*tensors(shard), Grid(size_px), decay=decay, lightest=0.8)
    for image, ranges, poses in zip(images, shard["ranges"], shard["poses"], strict=True):
        reference = slow_projection(ranges.astype(float), shard["angles"], poses, size_px, decay, 0.8)
        assert np.abs(image.numpy().astype(int) - reference).max() <= 1


def test_float32_moves_hardly_a_pixel(shard):
    exact = project(*tensors(shard), Grid(64))
    single = project(*tensors(shard, torch.float32), Grid(64))
    assert (exact != single).float().mean() < 1e-4


def one_run(hits):
    """Ranges (1, T, 1) and poses (1, T, 3) of one beam straight ahead from the map's centre."""
    ranges = torch.tensor(hits, dtype=torch.float32)[None, :, None]
    poses = torch.tensor([[25.0, 25.0, 0.0]]).expand(1, len(hits), 3)
    return ranges, torch.zeros(1), poses


def test_the_newest_reading_wins():
    image = project(*one_run([10.0, 20.0, 10.0]), Grid(50), lightest=0.8)[0]
    row = 24
    assert image[row, 35] == 0  # hit first and last
    assert image[row, 45] == round(255 * 0.4)  # hit in the middle
    assert (image < 255).sum() == 2


def test_gray_falls_linearly_from_the_oldest_to_the_newest():
    ranges, angles, poses = one_run([2.0 * step for step in range(1, 11)])
    shades = project(ranges, angles, poses, Grid(50), lightest=0.9)[0, 24, 27::2][:10]
    assert shades.tolist() == pytest.approx([255 * 0.9 * (1 - k / 9) for k in range(10)], abs=0.51)


def test_without_decay_every_hit_is_black():
    image = project(*one_run([5.0, 10.0, torch.inf, 20.0]), Grid(50), decay=False)
    assert sorted(image.unique().tolist()) == [0, 255]
    assert (image == 0).sum() == 3


def test_misses_and_hits_off_the_map_leave_no_trace():
    assert (project(*one_run([torch.inf, 26.0, 40.0]), Grid(50)) == 255).all()


def test_turning_the_poses_turns_the_image(shard):
    ranges, angles, poses = tensors(shard)
    turned = poses.clone()
    centred = poses[..., :2] - 25
    turned[..., 0], turned[..., 1] = 25 - centred[..., 1], 25 + centred[..., 0]
    turned[..., 2] += math.pi / 2
    image = project(ranges, angles, poses, Grid(64))
    again = project(ranges, angles, turned, Grid(64))
    assert (again != torch.rot90(image, 1, dims=(1, 2))).float().mean() < 1e-3


def test_mismatched_shapes_and_bad_grays_are_refused():
    ranges, angles, poses = one_run([5.0, 6.0])
    with pytest.raises(ValueError, match="expected ranges"):
        project(ranges, angles, poses[:, :1], Grid(8))
    with pytest.raises(ValueError, match=r"lightest must be in \[0, 1\)"):
        project(ranges, angles, poses, Grid(8), lightest=1.0)


def test_map_agrees_with_point_in_polygon_at_pixel_centres(shard):
    grid, runs = Grid(64), len(shard["ranges"]) // 2
    world = torch.as_tensor(shard["world"])
    states = torch.as_tensor(shard["states"][:, -1]).double()
    maps = rasterize(torch.as_tensor(shard["outlines"]).double(), states, world, runs, grid)
    y = grid.row_centers().numpy()
    x, y = np.meshgrid(y[::-1], y)
    for run in range(runs):
        expected = np.ones((64, 64), dtype=bool)
        for k in np.flatnonzero(shard["world"] == run):
            px, py, heading = states[k].tolist()
            polygon = affinity.rotate(Polygon(shard["outlines"][k]), heading, origin=(0, 0), use_radians=True)
            expected &= ~contains_xy(affinity.translate(polygon, px, py), x, y)
        assert np.array_equal(maps[run].numpy().astype(bool), expected)


def test_map_area_is_the_obstacle_area_at_any_resolution():
    square = torch.tensor([[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]]])
    state = torch.tensor([[20.0, 30.0, 0.3]])
    for size_px, tolerance in ((32, 0.05), (128, 0.01), (512, 0.002)):
        free = rasterize(square, state, torch.tensor([0]), 1, Grid(size_px)).float()
        assert (1 - free.mean().item()) * 2500 == pytest.approx(100, rel=tolerance)


def test_overlapping_obstacles_and_those_over_the_border_are_drawn_once_and_cut():
    square = torch.tensor([[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]]]).expand(3, -1, -1)
    states = torch.tensor([[25.0, 25.0, 0.0], [25.0, 25.0, 0.0], [0.0, 50.0, 0.0]])
    free = rasterize(square, states, torch.tensor([0, 0, 0]), 1, Grid(50))
    assert (free == 0).sum() == 100 + 25
    assert (free[0, :5, :5] == 0).all()
