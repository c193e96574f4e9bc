import numpy as np
import pytest

from repro.evaluation.coverage import coverage_and_visibility
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.maps.projection import Projection
from repro.recordings.datasets import load_pairs
from repro.recordings.reader import open_recordings

GRID = Grid(64, 50.0)


def test_coverage_is_the_obstacle_share(recorded):
    maps = load_pairs(open_recordings(recorded), "test", GRID, Projection()).maps
    coverage = coverage_and_visibility(open_recordings(recorded), "test", GRID)["coverage"]
    assert coverage == pytest.approx((maps == 0).float().mean().item())
    assert 0.04 < coverage < 0.14


def test_visibility_is_the_area_of_hit_obstacles(recorded):
    seen = total = 0
    for shard in open_recordings(recorded).shards("test"):
        for world in range(len(shard.scans) // 2):
            for number, k in enumerate((shard.world == world).nonzero()[0]):
                area = (rasterize(shard.outlines[[k]], shard.states[[k], -1], np.zeros(1, int), 1, GRID) == 0).sum()
                total += 2 * area
                seen += area * shard.seen[2 * world : 2 * world + 2, number].sum()
    assert coverage_and_visibility(open_recordings(recorded), "test", GRID)["visibility"] == pytest.approx(seen / total)
    assert 0.7 < seen / total <= 1


def test_obstacles_that_cover_no_pixel_are_refused(recorded):
    center_is_clear = Grid(1, 50.0)  # its only pixel has its center where the robot rotates
    with pytest.raises(ValueError, match=r"no obstacle of test covers the center of a pixel.*50.00 m wide"):
        coverage_and_visibility(open_recordings(recorded), "test", center_is_clear)
