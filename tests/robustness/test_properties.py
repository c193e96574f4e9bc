"""Generated configurations: accepted ones record and train one step, refused ones name a key."""

import copy
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import ROOT, read_calls, world_errors
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from repro.cli.refusals import Refused
from repro.evaluation.coverage import coverage_and_visibility
from repro.learning.losses import MapLoss
from repro.learning.networks.create import create_network
from repro.learning.training import TrainingModule
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.recordings.datasets import Batches, Pairs, load_pairs
from repro.recordings.format import shards_of
from repro.recordings.reader import open_recordings
from repro.runs.config import Training
from repro.runs.model import NETWORKS, paper_model
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
def test_accepted_worlds_can_be_recorded_and_learned_from(keys, data):
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
        learn(
            load_pairs(open_recordings(Path(folder)), "train", grid, create_encoding("projection", {})),
            Training(1e-3, 0, 0, 2, 1, 1e-6),
        )


def coverage_of(recordings, grid):
    """Return the coverage of the test maps, 0 where all obstacles are between the centers of the pixels."""
    try:
        return coverage_and_visibility(open_recordings(recordings), "test", grid)["coverage"]
    except ValueError as error:
        if "no obstacle of test covers the center of a pixel" not in str(error):
            raise
        return 0.0


def learn(examples, training, model="fpn"):
    """Train one step."""
    module = TrainingModule(
        create_network(paper_model(model)), examples, examples, training, 0, MapLoss(training.dice_eps)
    )
    optimizer = module.configure_optimizers()
    loss = module.training_step(next(iter(module.train_dataloader())), 0)
    loss.backward()
    optimizer.step()
    assert torch.isfinite(loss)
    assert len(list(Batches(examples, training.batch_size)))


USUAL = {
    "scale": "first", "scale.size_px": 32, "scale.pairs.train": 8, "scale.batch_size": 4, "scale.max_epochs": 1,
    "model": "fpn", "runtime.accelerator": "cpu",
}  # fmt: skip
SETTINGS = {
    "seed": st.integers(-2, 2**33),
    "oldest_gray": st.floats(-0.2, 1.2),
    "scale.size_px": st.integers(-1, 5).map(lambda number: 32 * number) | st.integers(-32, 160),
    "scale.pairs.train": st.integers(-2, 40),
    "scale.batch_size": st.integers(-1, 40),
    "scale.learning_rate": st.floats(-1e-3, 1e-2),
    "scale.ema_decay": st.just("null") | st.floats(-0.1, 1.1),
    "model": st.sampled_from([*NETWORKS, "vgg"]),
    "train.patience": st.integers(-1, 3),
}


@GENERATED
@given(st.sets(st.sampled_from(list(SETTINGS)), max_size=3), st.data())
def test_accepted_settings_train_a_step(keys, data):
    values = USUAL | {key: data.draw(SETTINGS[key]) for key in keys}
    try:
        (config,) = read_calls(*(f"{key}={value}" for key, value in values.items()))
    except Refused as refused:
        reasons = refused.args
    else:
        reasons = ()
    if reasons:
        assert all(any(key.split(".")[-1] in str(reason) for key in keys) for reason in reasons), reasons
        return
    generator = np.random.default_rng(config.seed)
    shape = (config.scale.pairs.train, 1, config.scale.size_px, config.scale.size_px)
    images = torch.from_numpy(generator.integers(0, 256, shape, dtype=np.uint8))
    encoding = create_encoding(config.encoding.name, config.encoding.parameters)
    learn(Pairs(images, images // 128, encoding), config.train, config.model.name)
