"""Generated worlds: accepted ones can be recorded, refused ones name a key."""

import copy
import os
import tempfile
from pathlib import Path

import pytest
from conftest import ROOT, world_errors
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from repro.evaluation.coverage import coverage_and_visibility
from repro.maps.grid import Grid
from repro.recordings.format import shards_of
from repro.recordings.reader import open_recordings
from repro.simulation.recorder import record_experiment, write_shard
from repro.worlds.spec import read_world, world_spec

pytestmark = pytest.mark.slow
EXAMPLES = int(os.environ.get("REPRO_EXAMPLES", "12"))  # if set, the examples are new ones in every run
WORLD = read_world(ROOT / "conf" / "world" / "paper.yaml")
GENERATED = settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize="REPRO_EXAMPLES" not in os.environ,
    suppress_health_check=list(HealthCheck),
)


def pairs(low, high, whole=False):
    """Generate two numbers, ordered or not, valid or not."""
    number = st.integers(int(low), int(high)) if whole else st.floats(low, high)
    return st.tuples(number, number).map(list)


WORLDS = {
    ("world", "width"): st.sampled_from([50, 50, 50, 80, 20, 0]),
    ("world", "step_time"): st.floats(-0.01, 0.3),
    ("robot", "shape", "radius"): st.floats(-0.1, 3),
    ("robot", "sensors", 0, "range_max"): st.floats(-1, 60),
    ("robot", "sensors", 0, "angle_range"): st.floats(-0.1, 7),
    ("robot", "sensors", 0, "number"): st.integers(0, 200),
    ("motions", "square", "side_m"): st.floats(-1, 20),
    ("motions", "square", "first_steps"): st.integers(-1, 22),
    ("obstacles", "count"): pairs(-1, 14, whole=True),
    ("obstacles", "radius_m"): pairs(-0.2, 6),
    ("obstacles", "aspect"): pairs(0.5, 4),
    ("obstacles", "disc_share"): st.floats(-0.1, 1.1),
    ("obstacles", "behavior", "speed_m_s"): pairs(-0.1, 4),
    ("obstacles", "behavior", "turn_steps"): pairs(-1, 120, whole=True),
    ("clear_radius_m",): st.floats(-1, 15),
}


def changed(values):
    """Return the paper's world with some values changed, in experiment 4 where it has its own."""
    world = copy.deepcopy(WORLD)
    for path, value in values.items():
        *parents, last = path
        node = world if path[0] in world and path[0] != "obstacles" else world["experiments"]["4"]
        for key in parents:
            node = node[key]
        node[last] = value
    world["world"]["height"] = world["world"]["width"]
    world["experiments"]["4"]["motion"] = world["motions"]["square"]
    return world


@GENERATED
@given(st.sets(st.sampled_from(list(WORLDS)), max_size=3), st.data())
def test_accepted_worlds_can_be_recorded(keys, data):
    world = changed({key: data.draw(WORLDS[key]) for key in keys})
    errors = world_errors(world)
    if errors:
        assert all(str(error).startswith("world.") for error in errors)
        return
    spec = world_spec(world, "4")
    with tempfile.TemporaryDirectory() as folder:
        stopped = ""
        try:
            for shard in shards_of({"train": 4, "val": 2, "test": 2}):
                write_shard(Path(folder), shard, spec, verify_every=10**9)
        except ValueError as error:
            stopped = str(error)
        if stopped:  # without a clear zone, only the simulation shows it
            assert spec.clear_radius_m == 0, stopped
            assert "reaches the robot: enlarge clear_radius_m" in stopped
            return
        record_experiment(Path(folder), spec, {"train": 4, "val": 2, "test": 2}, workers=1)
        assert open_recordings(Path(folder)).hash()
        grid = Grid(32, float(world["world"]["width"]))
        assert 0 <= coverage_of(Path(folder), grid) <= 1


def coverage_of(recordings, grid):
    """Return the coverage of the test maps, 0 where all obstacles are between the centers of the pixels."""
    try:
        return coverage_and_visibility(open_recordings(recordings), "test", grid)["coverage"]
    except ValueError as error:
        if "no obstacle of test covers the center of a pixel" not in str(error):
            raise
        return 0.0
