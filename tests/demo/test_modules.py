"""The JavaScript modules of the page compute what Python computes, on recorded worlds of all four experiments."""

import json
import shutil
import subprocess
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import world_spec

from repro.demo.page import ASSETS
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.metrics.counts import counts_of, pooled_scores
from repro.simulation.simulator import simulate
from repro.simulation.worlds import reverse_direction, sample_world

pytestmark = pytest.mark.slow

GRID = Grid(128, 50.0)
ENCODINGS = [
    {"name": "projection", "parameters": {"decay": True, "oldest_gray": 0.8}},
    {"name": "projection", "parameters": {"decay": False, "oldest_gray": 0.8}},
    {"name": "stack4", "parameters": {"frames": 4}},
    {"name": "series10", "parameters": {"frames": 10, "range_max_m": 30.0}},
]
DIFFERENT_PIXELS = 3  # of 16,384: points within float32 of the border of a pixel


def record(experiment, seed, reverse):
    world = sample_world(world_spec(experiment), seed)
    world = reverse_direction(world) if reverse else world
    return world, simulate(world)


def truth_of(recording):
    outlines = torch.as_tensor(recording.outlines).float()
    states = torch.as_tensor(recording.states[:, -1]).float()
    return rasterize(outlines, states, torch.zeros(len(states), dtype=torch.long), 1, GRID)


def plain(world, recording, free):
    scans = recording.scans
    behavior = dict(world["robot"]["behavior"])
    return {
        "ranges": np.where(np.isfinite(scans.ranges), scans.ranges, None).tolist(),
        "angles": scans.angles.tolist(),
        "poses": scans.poses.tolist(),
        "shapes": [obstacle["shape"] for obstacle in world["obstacle"]],
        "states": recording.states.tolist(),
        "direction": behavior.pop("direction"),
        "motion": behavior,
        "sizeM": world["world"]["width"],
        "stepTime": world["world"]["step_time"],
        "lidar": world["robot"]["sensors"][0],
        "grid": asdict(GRID),
        "encodings": ENCODINGS,
        "free": free.flatten().tolist(),
    }


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Return worlds, their recordings, a made prediction of each, and what the modules compute from them."""
    node = shutil.which("node")
    if not node:
        pytest.skip("no Node.js on this machine (Debian: apt install nodejs)")
    recorded = [record("1", 5, False), record("2", 6, True), record("3", 7, True), *[record("4", 8, r) for r in (0, 1)]]
    free = torch.rand(len(recorded), 128, 128, generator=torch.Generator().manual_seed(0))
    free[:, :20] = 0.5  # at the threshold
    path = tmp_path_factory.mktemp("demo") / "recordings.json"
    path.write_text(json.dumps([plain(*each, free[i]) for i, each in enumerate(recorded)]))
    command = [node, str(Path(__file__).with_name("check_modules.mjs")), str(ASSETS), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)
    assert len(results) == len(recorded)
    return [(*each, free[i], results[i]) for i, each in enumerate(recorded)]


def test_outlines_and_beams_are_those_of_ir_sim(compared):
    for _, recording, _, result in compared:
        np.testing.assert_allclose(result["angles"], recording.scans.angles, atol=1e-12)
        for outline, expected in zip(result["outlines"], recording.outlines, strict=True):
            points = np.reshape(outline, (-1, 2))
            np.testing.assert_allclose(points, expected[: len(points)], atol=1e-12)


def test_the_robot_takes_the_recorded_path(compared):
    for _, recording, _, result in compared:
        path, poses = np.array(result["path"]), recording.scans.poses
        np.testing.assert_allclose(path[:, :2], poses[:, :2], atol=1e-9)
        np.testing.assert_allclose(np.exp(1j * path[:, 2]), np.exp(1j * poses[:, 2]), atol=1e-9)


def test_ray_casting_gives_the_recorded_ranges(compared):
    hits = 0
    for _, recording, _, result in compared:
        ranges = np.array(result["ranges"], dtype=float)  # None, a miss, becomes nan
        expected = recording.scans.ranges
        np.testing.assert_array_equal(np.isfinite(ranges), np.isfinite(expected))
        hit = np.isfinite(expected)
        np.testing.assert_allclose(ranges[hit], expected[hit], atol=1e-9)
        hits += hit.sum()
    assert hits > 5000


@pytest.mark.parametrize("number", range(len(ENCODINGS)))
def test_encodings_give_the_images_and_inputs_of_python(compared, number):
    encoding = create_encoding(**ENCODINGS[number])
    for _, recording, _, result in compared:
        expected = encoding.encode(recording.scans.tensors(), GRID)
        drawn = torch.tensor(result["images"][number]["drawn"], dtype=torch.uint8).view(expected.shape)
        assert (drawn != expected).sum(dim=(2, 3)).max() <= DIFFERENT_PIXELS
        assert (expected < 255).sum() > 100
        given = torch.tensor(result["images"][number]["input"], dtype=torch.float32).view(drawn.shape)
        torch.testing.assert_close(given, encoding.to_input(drawn), atol=1e-6, rtol=0)


def test_true_maps_and_scores_are_those_of_python(compared):
    for _, recording, free, result in compared:
        expected = truth_of(recording)[0]
        drawn = torch.tensor(result["map"], dtype=torch.uint8).view(expected.shape)
        assert (drawn != expected).sum() <= DIFFERENT_PIXELS
        values = pooled_scores(counts_of(free[None, None], drawn[None, None])[0])
        assert result["iou"] == pytest.approx(float(values["obstacle_iou"]), abs=1e-9)
        assert result["accuracy"] == pytest.approx(float(values["accuracy"]), abs=1e-9)
