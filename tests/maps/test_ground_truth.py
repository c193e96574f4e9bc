import numpy as np
import pytest
import shapely
from shapely import LineString, affinity, contains_xy
from shapely.geometry import Polygon

from repro.maps.grid import Grid
from repro.maps.ground_truth import areas_of, rasterize
from repro.recordings.reader import open_recordings


@pytest.fixture(scope="module")
def shard(recorded):
    return next(open_recordings(recorded).shards("test"))


def test_the_map_agrees_with_point_in_polygon_at_pixel_centers(shard):
    grid, worlds = Grid(64, 50.0), len(shard.scans) // 2
    states = shard.states[:, -1].astype(float)
    maps = rasterize(shard.outlines.astype(float), states, shard.world, worlds, grid)
    y = grid.row_centers()
    x, y = np.meshgrid(y[::-1], y)
    for index in range(worlds):
        expected = np.ones((64, 64), dtype=bool)
        for k in np.flatnonzero(shard.world == index):
            px, py, heading = states[k].tolist()
            polygon = affinity.rotate(Polygon(shard.outlines[k]), heading, origin=(0, 0), use_radians=True)
            expected &= ~contains_xy(affinity.translate(polygon, px, py), x, y)
        assert np.array_equal(maps[index].astype(bool), expected)


def test_overlapping_obstacles_are_drawn_once_and_those_over_the_border_are_cut():
    square = np.array([[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]]] * 3)
    states = np.array([[25.0, 25.0, 0.0], [25.0, 25.0, 0.0], [0.0, 50.0, 0.0]])
    free = rasterize(square, states, np.zeros(3, int), 1, Grid(50, 50.0))
    assert (free == 0).sum() == 100 + 25
    assert (free[0, :5, :5] == 0).all()


L_SHAPE = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]]
U_SHAPE = [[-3, -3], [3, -3], [3, 3], [2, 3], [2, -2], [-2, -2], [-2, 3], [-3, 3]]
STAR = [[(3 if k % 2 else 1) * f(k * np.pi / 5) for f in (np.cos, np.sin)] for k in range(10)]
COMB = [[0, 0], [7, 0], [7, 3], [6, 3], [6, 1], [5, 1], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [0, 1]]


def padded(outlines):
    """Outlines of one length, the last vertex of the shorter ones repeated."""
    longest = max(map(len, outlines))
    return np.array([[*outline, *[outline[-1]] * (longest - len(outline))] for outline in outlines], np.float32)


def there_and_back(line):
    return [*line, *line[-2:0:-1]]


@pytest.mark.parametrize("shape", [L_SHAPE, U_SHAPE, STAR, COMB], ids=["L", "U", "star", "comb"])
@pytest.mark.parametrize("order", [1, -1])
def test_concave_polygons_agree_with_point_in_polygon(shape, order):
    grid, rng = Grid(96, 20.0), np.random.default_rng(0)
    states = np.concatenate([rng.uniform(2, 18, (20, 2)), rng.uniform(-np.pi, np.pi, (20, 1))], axis=1)
    outlines = np.repeat(padded([shape[::order], [[0, 0]] * 40])[:1], 20, axis=0).astype(float)
    maps = rasterize(outlines, states, np.arange(20), 20, grid)
    centers = grid.centers()
    for drawn, (x, y, heading) in zip(maps, states, strict=True):
        polygon = affinity.rotate(Polygon(shape), heading, origin=(0, 0), use_radians=True)
        truth = contains_xy(affinity.translate(polygon, x, y), centers[:, 0], centers[:, 1])
        assert np.array_equal(drawn.ravel() == 0, truth)
        assert truth.sum() > 50


def test_a_line_occupies_the_pixels_that_it_crosses():
    grid, rng = Grid(40, 20.0), np.random.default_rng(1)
    lines = [rng.uniform(1, 19, (rng.integers(2, 6), 2)).tolist() for _ in range(40)]
    lines += [[[3.1, 4.3], [15.2, 4.3]], [[3.1, 4.3], [3.1, 17.9]], [[2.1, 2.2], [9.2, 2.2], [9.2, 9.3], [2.1, 2.2]]]
    outlines = padded([there_and_back(line) for line in lines]).astype(float)
    maps = rasterize(outlines, np.zeros((len(lines), 3)), np.arange(len(lines)), len(lines), grid)
    half = grid.resolution_m / 2
    pixels = shapely.box(*(grid.centers().T - half), *(grid.centers().T + half))
    for drawn, line in zip(maps, lines, strict=True):
        truth = shapely.intersects(pixels, LineString(np.float32(line)))
        assert np.array_equal(drawn.ravel() == 0, truth)


def test_only_lines_have_no_area():
    thin, far = [[0, 0], [10, 0], [10, 0.05], [0, 0.05]], [[9000 + x, 9000 + y] for x, y in [[0, 0], [1, 0], [1, 0.1]]]
    outlines = [thin, far, L_SHAPE[::-1], there_and_back([[0, 0], [1, 2], [5, 3], [0, 0]])]
    assert areas_of(padded(outlines)).tolist() == pytest.approx([0.5, 0.05, -6, 0], rel=0.1)


def test_obstacles_of_all_kinds_overlap_on_one_map():
    grid = Grid(64, 20.0)
    outlines = padded([L_SHAPE, L_SHAPE[::-1], U_SHAPE, [[0, 0], [5, 0], [5, 5]], there_and_back([[0, 0], [6, 6]])])
    states = np.array([[8.0, 8, 0], [8, 8, 0.1], [9, 9, 1], [7, 7, 2], [6, 6, 0.3]])
    alone = rasterize(outlines, states, np.arange(5), 5, grid)
    together = rasterize(outlines, states, np.zeros(5, int), 1, grid)
    assert np.array_equal(together[0], alone.min(0))
