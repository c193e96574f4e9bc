import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.scans import Scans


def drawn(points: list | np.ndarray, grid: Grid) -> np.ndarray:
    """Return the steps of the pixels of points, which a lidar hits from 1 m to their left, one after another."""
    poses = np.column_stack([np.array(points, dtype=np.float32) - [1, 0], np.zeros(len(points))])
    return newest_hits(Scans(np.ones((len(points), 1)), np.zeros(1), poses).batched(), grid)[0]


def test_the_corners_of_the_map_are_the_corners_of_the_image():
    steps = drawn([[0.1, 49.9], [49.9, 49.9], [0.1, 0.1], [49.9, 0.1]], Grid(4, 50.0))
    assert [steps[0, 0], steps[0, 3], steps[3, 0], steps[3, 3]] == [1, 2, 3, 4]


@pytest.mark.parametrize(
    "point", [[-0.01, 25], [50.01, 25], [25, -0.01], [25, 50.01], [np.inf, 0], [np.nan, 3], [1e30, 1e30]]
)
def test_points_off_the_map_are_in_no_pixel(point):
    assert not drawn([point], Grid(8, 50.0)).any()


def test_every_pixel_center_is_in_its_own_pixel():
    grid = Grid(16, 50.0)
    assert np.array_equal(drawn(grid.centers(), grid).ravel(), np.arange(1, 257))
    assert np.array_equal(grid.centers()[::16, 1], grid.row_centers())


def test_first_column_is_the_first_center_not_left_of_x():
    grid = Grid(5, 50.0)  # centers at 5, 15, 25, 35, 45
    x = np.array([-3.0, 5.0, 5.1, 44.9, 45.1, 99.0])
    assert grid.first_column(x).tolist() == [0, 0, 1, 4, 5, 5]
