import math

import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.maps.visibility import newest_in_view, newest_visible
from repro.scans import Scans, wrapped


def look(*headings):
    """Scans of a robot in the middle of the map that looks along each heading in turn."""
    poses = np.array([[25.0, 25.0, heading] for heading in headings])
    return Scans(np.full((len(headings), 91), np.inf), np.linspace(-math.pi / 4, math.pi / 4, 91), poses).batched()


def test_the_newest_step_counts_and_0_means_never():
    scans = look(0.0, math.pi / 2, 0.0)
    visible = newest_visible(scans, Grid(50, 50.0), 20.0)
    walls = Scans(np.full_like(scans.ranges, 3.0), scans.angles, scans.poses)
    assert np.array_equal(visible, newest_in_view(walls, Grid(50, 50.0), 20.0))
    assert visible[0, 25, 40] == 3
    assert visible[0, 10, 25] == 2
    assert visible[0, 25, 5] == 0
    assert visible[0, 25, 46] == 0  # beyond the range


@pytest.mark.parametrize("last", [179, 180], ids=["once", "backward beam twice, as in IR-SIM"])
def test_a_lidar_of_360_degrees_sees_all_directions(last):
    angles = np.arange(-180, last + 1) * math.pi / 180
    scans = Scans(np.full((1, len(angles)), np.inf), angles, np.array([[25.0, 25.0, 1.0]])).batched()
    grid = Grid(64, 50.0)
    visible = newest_visible(scans, grid, 20.0)
    distance = np.linalg.norm(grid.centers() - 25, axis=-1).reshape(64, 64)
    assert np.array_equal(visible[0] > 0, distance <= 20)


@pytest.mark.parametrize("angles", [[0.0, 0.1, 0.3], [0.3, 0.2, 0.1], [0.0], [0.0, 3.2]])
def test_uneven_beams_are_refused(angles):
    scans = Scans(np.ones((1, 1, len(angles))), np.array(angles), np.zeros((1, 1, 3)))
    with pytest.raises(ValueError, match="beam angles must rise evenly"):
        newest_visible(scans, Grid(8, 50.0), 30.0)


@pytest.mark.parametrize("margin_m", [1.0, -3.0])
def test_every_pixel_belongs_to_the_nearest_beam(margin_m):
    rng = np.random.default_rng(0)
    grid, angles = Grid(64, 50.0), np.linspace(-math.pi / 4, math.pi / 4, 100)
    ranges = 30 * rng.random((40, 1, 100))
    ranges[rng.random(ranges.shape) < 0.5] = np.inf
    poses = np.concatenate([60 * rng.random((40, 1, 2)) - 5, 10 * rng.normal(size=(40, 1, 1))], axis=-1)
    poses[:8, 0, 2] = np.arange(8) * math.pi / 4  # beams and edges of the view along the axes
    scans = Scans(ranges, angles, poses).batched()
    found = newest_visible(scans, grid, 20.0, margin_m=margin_m).reshape(40, -1)

    poses = scans.poses.astype(float)
    to_pixel = grid.centers() - poses[..., :2]  # (40, 4096, 2)
    bearing = np.arctan2(to_pixel[..., 1], to_pixel[..., 0]) - poses[..., 2]
    beam = np.rint((wrapped(bearing) + math.pi / 4) / (math.pi / 2 / 99)).astype(int)
    within = (beam >= 0) & (beam < 100)
    reach = np.minimum(np.minimum(scans.ranges[:, 0], 20) + margin_m, 20)
    expected = within & (np.linalg.norm(to_pixel, axis=-1) <= np.take_along_axis(reach, beam.clip(0, 99), 1))
    assert ((found > 0) != expected).sum() <= 2  # a pixel on an edge may fall to either side
    assert expected.mean() > 0.02


def test_nothing_is_visible_from_an_unknown_pose():
    known, grid = look(0.0), Grid(50, 50.0)
    assert np.array_equal(newest_visible(look(0.0, math.nan), grid, 20.0), newest_visible(known, grid, 20.0))


def test_an_invalid_reading_marks_nothing_and_leaves_the_other_beams_as_they_are():
    ranges = np.where(np.arange(29) % 7 > 0, np.linspace(5, 20, 29), np.inf)
    lost = np.arange(29) % 5 == 0
    found, only_lost, expected = (
        newest_visible(
            Scans(readings[None], np.linspace(-0.7, 0.7, 29), np.array([[25.0, 25.0, 0.3]])).batched(),
            Grid(64, 50.0),
            30.0,
        )
        for readings in (np.where(lost, np.nan, ranges), np.where(lost, ranges, np.nan), ranges)
    )
    assert found.any()
    assert only_lost.any()
    assert not ((found > 0) & (only_lost > 0)).any()
    assert np.array_equal(found | only_lost, expected)
