"""What a lidar shows of a true map, and the loss in which it counts more."""

import numpy as np
import pytest
import torch
from shapely import LineString, Point, Polygon

from repro.learning.losses import HIDDEN_WEIGHT, ShownLoss, bce_loss
from repro.maps.grid import Grid
from repro.maps.visibility import shown_pixels

GRID = Grid(40, 10.0)


def test_pixels_up_to_the_first_obstacle_are_shown():
    """Compared with straight lines to the centers of pixels, apart from those that pass near a corner."""
    maps = np.ones((2, 40, 40), np.uint8)
    maps[1, 10:14, 10:30] = 0  # y from 6.5 to 7.5 m, x from 2.5 to 7.5 m
    poses = np.array([[5.0, 3.0, 0.3], [5.0, 3.0, 0.3]])
    shown = shown_pixels(maps, poses, GRID)
    assert shown[0].all()
    block = Polygon([(2.5, 6.5), (7.5, 6.5), (7.5, 7.5), (2.5, 7.5)])
    for place, is_shown in zip(GRID.centers(), shown[1].flatten(), strict=True):
        way, inside = LineString([(5.0, 3.0), place]), block.contains(Point(place))
        if not inside and abs(way.distance(block)) > 0.3:
            assert is_shown
        if not inside and way.intersection(block).length > 0.6:
            assert not is_shown
    assert shown[1, 13, 12:28].all()
    assert not shown[1, 11, 12:28].any()


def test_a_lidar_off_the_map_shows_the_side_that_it_sees():
    maps = np.ones((1, 40, 40), np.uint8)
    maps[:, :, 20] = 0  # a wall at x from 5 to 5.25 m
    shown = shown_pixels(maps, np.array([[-2.0, 5.0, 0.0]]), GRID)[0]
    assert shown[:, :21].mean() > 0.95
    assert not shown[:, 21:].any()


def test_hidden_pixels_count_less():
    logits = torch.tensor(np.random.default_rng(0).normal(size=(1, 1, 4, 4)), dtype=torch.float32)
    target = torch.tensor([0.0, 1, 0, 1]).repeat(4).view(1, 1, 4, 4)
    hidden = torch.zeros_like(target)
    assert ShownLoss()(logits, target) == pytest.approx(bce_loss(logits, target).item())
    hidden[..., :2] = 1
    shown, rest = (bce_loss(logits, target, known).item() for known in (1 - hidden, hidden))
    found = ShownLoss()(logits, target + 2 * hidden).item()
    assert found == pytest.approx((shown + HIDDEN_WEIGHT * rest) / (1 + HIDDEN_WEIGHT))
