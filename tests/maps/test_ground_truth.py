import numpy as np
import pytest
import torch
from shapely import affinity, contains_xy
from shapely.geometry import Polygon

from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.recordings.reader import read_shards


@pytest.fixture(scope="module")
def shard(recorded):
    return next(read_shards(recorded, "test"))


def test_the_map_agrees_with_point_in_polygon_at_pixel_centers(shard):
    grid, worlds = Grid(64, 50.0), len(shard.scans) // 2
    world = torch.as_tensor(shard.world)
    states = torch.as_tensor(shard.states[:, -1]).double()
    maps = rasterize(torch.as_tensor(shard.outlines).double(), states, world, worlds, grid)
    y = grid.row_centers().numpy()
    x, y = np.meshgrid(y[::-1], y)
    for index in range(worlds):
        expected = np.ones((64, 64), dtype=bool)
        for k in np.flatnonzero(shard.world == index):
            px, py, heading = states[k].tolist()
            polygon = affinity.rotate(Polygon(shard.outlines[k]), heading, origin=(0, 0), use_radians=True)
            expected &= ~contains_xy(affinity.translate(polygon, px, py), x, y)
        assert np.array_equal(maps[index].numpy().astype(bool), expected)


def test_the_map_has_the_obstacle_area_at_any_resolution():
    square = torch.tensor([[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]]])
    state = torch.tensor([[20.0, 30.0, 0.3]])
    for size_px, tolerance in ((32, 0.05), (128, 0.01), (512, 0.002)):
        free = rasterize(square, state, torch.tensor([0]), 1, Grid(size_px, 50.0)).float()
        assert (1 - free.mean().item()) * 2500 == pytest.approx(100, rel=tolerance)


def test_overlapping_obstacles_are_drawn_once_and_those_over_the_border_are_cut():
    square = torch.tensor([[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]]]).expand(3, -1, -1)
    states = torch.tensor([[25.0, 25.0, 0.0], [25.0, 25.0, 0.0], [0.0, 50.0, 0.0]])
    free = rasterize(square, states, torch.tensor([0, 0, 0]), 1, Grid(50, 50.0))
    assert (free == 0).sum() == 100 + 25
    assert (free[0, :5, :5] == 0).all()
