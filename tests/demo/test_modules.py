"""The JavaScript modules of the page compute what Python computes, on recorded worlds of all four experiments."""

import json
import shutil
import subprocess
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from conftest import world_spec

from repro.demo.demo_page import ASSETS
from repro.demo.worlds import FILE, describe, describe_world
from repro.maps.encodings import create_encoding, to_input
from repro.maps.grid import Grid
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.simulator import simulate

pytestmark = pytest.mark.slow

GRID = Grid(128, 50.0)
ENCODINGS = [
    {"name": "projection", "parameters": {"decay": True, "oldest_gray": 0.8}},
    {"name": "projection", "parameters": {"decay": False, "oldest_gray": 0.8}},
    {"name": "stack4", "parameters": {"frames": 4}},
    {"name": "series10", "parameters": {"frames": 10, "range_max_m": 30.0}},
]
DIFFERENT_PIXELS = 3  # of 16,384: points within float32 of the border of a pixel


def test_the_worlds_of_the_page_are_those_of_the_study():
    assert json.loads(FILE.read_text()) == describe(), "run python -m repro.demo.worlds"


def record(experiment, seed, reverse):
    world = sample_world(world_spec(experiment), seed)
    world = reverse_direction(world) if reverse else world
    return world, simulate(world)


def plain(world, recording):
    scans = recording.scans
    return {
        "world": describe_world(world, len(scans.poses)),
        "steps": len(scans.poses),
        "ranges": np.where(np.isfinite(scans.ranges), scans.ranges, None).tolist(),
        "angles": scans.angles.tolist(),
        "poses": scans.poses.tolist(),
        "places": [*recording.states[:, -1, :2].tolist(), [25.0, 25.0]],
        "lidar": world["robot"]["sensors"][0],
        "grid": asdict(GRID),
        "encodings": ENCODINGS,
    }


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Return recordings of worlds, and what the modules compute from them."""
    node = shutil.which("node")
    if not node:
        pytest.skip("no Node.js on this machine (Debian: apt install nodejs)")
    recorded = [record("1", 5, False), record("2", 6, True), record("3", 7, True), *[record("4", 8, r) for r in (0, 1)]]
    path = tmp_path_factory.mktemp("demo") / "recordings.json"
    path.write_text(json.dumps([plain(*arguments) for arguments in recorded]))
    command = [node, str(Path(__file__).with_name("check_modules.mjs")), str(ASSETS), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return [(recording, result) for (_, recording), result in zip(recorded, json.loads(done.stdout), strict=True)]


def test_the_robot_takes_the_recorded_path_and_ray_casting_gives_the_recorded_ranges(compared):
    hits = 0
    for recording, result in compared:
        poses, expected = recording.scans.poses, recording.scans.ranges
        np.testing.assert_allclose(np.array(result["poses"])[:, :2], poses[:, :2], atol=1e-6)
        ranges = np.array(result["ranges"], dtype=float)  # None, a miss, becomes nan
        hit = np.isfinite(ranges) & np.isfinite(expected)
        assert (np.isfinite(ranges) != np.isfinite(expected)).mean() < 1e-3  # outlines are rounded to 0.1 mm
        assert np.quantile(np.abs(ranges - expected)[hit], 0.999) < 0.01
        hits += hit.sum()
    assert hits > 5000


def test_the_obstacle_at_a_point_is_found(compared):
    for recording, result in compared:
        assert result["found"] == [*range(len(recording.states)), -1]


@pytest.mark.parametrize("number", range(len(ENCODINGS)))
def test_encodings_give_the_images_and_inputs_of_python(compared, number):
    encoding = create_encoding(**ENCODINGS[number])
    for recording, result in compared:
        expected = encoding.encode(recording.scans.batched(), GRID)
        drawn = np.array(result["images"][number]["drawn"], np.uint8).reshape(expected.shape)
        assert (drawn != expected).sum((2, 3)).max() <= DIFFERENT_PIXELS
        assert (expected < 255).sum() > 100
        given = np.array(result["images"][number]["input"], np.float32).reshape(drawn.shape)
        np.testing.assert_allclose(given, to_input(drawn, inverted=encoding.is_inverted), atol=1e-6, rtol=0)
