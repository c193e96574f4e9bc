import math

import pytest
import torch

from repro.maps.grid import Grid
from repro.maps.visibility import newest_in_view, newest_visible
from repro.scans import Scans


def look(*headings):
    """Scans of a robot in the middle of the map that looks along each heading in turn."""
    poses = torch.tensor([[25.0, 25.0, heading] for heading in headings])[None]
    angles = torch.linspace(-math.pi / 4, math.pi / 4, 91)
    return Scans(torch.full((1, len(headings), 91), torch.inf), angles, poses)


def test_the_newest_step_counts_and_0_means_never():
    scans = look(0.0, math.pi / 2, 0.0)
    visible = newest_visible(scans, Grid(50, 50.0), 20.0)
    walls = Scans(torch.full_like(scans.ranges, 3.0), scans.angles, scans.poses)
    assert torch.equal(visible, newest_in_view(walls, Grid(50, 50.0), 20.0))
    assert visible[0, 25, 40] == 3
    assert visible[0, 10, 25] == 2
    assert visible[0, 25, 5] == 0
    assert visible[0, 25, 46] == 0  # beyond the range


@pytest.mark.parametrize("last", [179, 180], ids=["once", "backward beam twice, as in IR-SIM"])
def test_a_lidar_of_360_degrees_sees_all_directions(last):
    angles = torch.arange(-180, last + 1) * math.pi / 180
    scans = Scans(torch.full((1, 1, len(angles)), torch.inf), angles, torch.tensor([[[25.0, 25.0, 1.0]]]))
    grid = Grid(64, 50.0)
    visible = newest_visible(scans, grid, 20.0)
    distance = (grid.centers() - 25).norm(dim=-1).view(64, 64)
    assert torch.equal(visible[0] > 0, distance <= 20)


@pytest.mark.parametrize("angles", [[0.0, 0.1, 0.3], [0.3, 0.2, 0.1], [0.0], [0.0, 3.2]])
def test_uneven_beams_are_refused(angles):
    scans = Scans(torch.ones(1, 1, len(angles)), torch.tensor(angles), torch.zeros(1, 1, 3))
    with pytest.raises(ValueError, match="beam angles must rise evenly"):
        newest_visible(scans, Grid(8, 50.0), 30.0)


@pytest.mark.parametrize("margin_m", [1.0, -3.0])
def test_every_pixel_belongs_to_the_nearest_beam(margin_m):
    torch.manual_seed(0)
    grid, angles = Grid(64, 50.0), torch.linspace(-math.pi / 4, math.pi / 4, 100)
    ranges = 30 * torch.rand(40, 1, 100)
    ranges[torch.rand(ranges.shape) < 0.5] = torch.inf
    poses = torch.cat([60 * torch.rand(40, 1, 2) - 5, 10 * torch.randn(40, 1, 1)], dim=-1)
    poses[:8, 0, 2] = torch.arange(8) * math.pi / 4  # beams and edges of the view along the axes
    found = newest_visible(Scans(ranges, angles, poses), grid, 20.0, margin_m=margin_m)

    to_pixel = grid.centers().double() - poses[..., :2].double()  # (40, 4096, 2)
    bearing = torch.atan2(to_pixel[..., 1], to_pixel[..., 0]) - poses[..., 2].double()
    beam = torch.round((torch.remainder(bearing + math.pi, 2 * math.pi) - math.pi + math.pi / 4) / (math.pi / 2 / 99))
    within = (beam >= 0) & (beam < 100)
    reach = (ranges[:, 0].double().clamp(max=20) + margin_m).clamp(max=20).gather(1, beam.clamp(0, 99).long())
    expected = within & (to_pixel.norm(dim=-1) <= reach)
    assert (found.flatten(1) > 0).ne(expected).sum() <= 2  # a pixel on an edge may fall to either side
    assert expected.float().mean() > 0.02


def test_nothing_is_visible_from_an_unknown_pose():
    known, grid = look(0.0), Grid(50, 50.0)
    assert torch.equal(newest_visible(look(0.0, math.nan), grid, 20.0), newest_visible(known, grid, 20.0))


def test_an_invalid_reading_marks_nothing_and_leaves_the_other_beams_as_they_are():
    angles = torch.linspace(-0.7, 0.7, 29)
    ranges = torch.linspace(5, 20, 29).where(torch.arange(29) % 7 > 0, torch.inf).view(1, 1, 29)
    poses = torch.tensor([[[25.0, 25.0, 0.3]]])
    lost = torch.arange(29) % 5 == 0
    found = newest_visible(Scans(ranges.masked_fill(lost, torch.nan), angles, poses), Grid(64, 50.0), 30.0)
    expected = newest_visible(Scans(ranges, angles, poses), Grid(64, 50.0), 30.0)
    only_lost = newest_visible(Scans(ranges.masked_fill(~lost, torch.nan), angles, poses), Grid(64, 50.0), 30.0)
    assert found.any()
    assert only_lost.any()
    assert not (found.bool() & only_lost.bool()).any()
    assert torch.equal(found | only_lost, expected)
