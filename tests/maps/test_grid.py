import torch

from repro.maps.grid import Grid


def test_the_corners_of_the_map_are_the_corners_of_the_image():
    points = torch.tensor([[0.1, 49.9], [49.9, 49.9], [0.1, 0.1], [49.9, 0.1]])
    index, inside = Grid(4, 50.0).pixels(points)
    assert inside.all()
    assert index.tolist() == [0, 3, 12, 15]  # top left, top right, bottom left, bottom right


def test_points_off_the_map_are_outside():
    points = torch.tensor([[-0.01, 25], [50.01, 25], [25, -0.01], [25, 50.01], [torch.inf, 0], [torch.nan, 3]])
    index, inside = Grid(8, 50.0).pixels(points)
    assert not inside.any()
    assert index.tolist() == [0] * 6


def test_every_pixel_center_is_in_its_own_pixel():
    grid = Grid(16, 50.0)
    y = grid.row_centers()
    x = y.flip(0)
    points = torch.stack([x.expand(16, 16), y[:, None].expand(16, 16)], dim=-1)
    index, inside = grid.pixels(points)
    assert inside.all()
    assert torch.equal(index.flatten(), torch.arange(256))


def test_first_column_is_the_first_center_not_left_of_x():
    grid = Grid(5, 50.0)  # centers at 5, 15, 25, 35, 45
    x = torch.tensor([-3.0, 5.0, 5.1, 44.9, 45.1, 99.0])
    assert grid.first_column(x).tolist() == [0, 0, 1, 4, 5, 5]
