import dataclasses
import shutil

import numpy as np
import pytest
import segmentation_models_pytorch as smp
import torch
from conftest import ROOT, damage, world_spec

from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork, load_trained, module_of, save_trained
from repro.maps.grid import Grid
from repro.maps.projection import Projection, newest_hits
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.stream import PredictionStream
from repro.runs.model import paper_model
from repro.scans import Scans
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.simulator import simulate

PUBLISHED = ROOT / "reproduce" / "results" / "workstation" / "exp4-unet"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Save a predictor with an unusual encoding and map; return it and its directory."""
    torch.manual_seed(0)
    predictor = Predictor(
        TorchNetwork(create_network(paper_model("fpn"))),
        Projection(decay=False, oldest_gray=0.5),
        Grid(64, 80.0),
        **{"steps": 40, "step_s": 0.5},
    )
    directory = tmp_path_factory.mktemp("predictor") / "model"
    save_trained(predictor, directory)
    return predictor, directory


@pytest.fixture(scope="module")
def scans():
    world = sample_world(world_spec("4"), 17)
    return Scans.stack([simulate(item).scans for item in (world, reverse_direction(world))])


def test_encoding_and_grid_are_saved_with_the_weights(saved, scans):
    predictor, directory = saved
    again = load_trained(directory)
    assert dataclasses.replace(again, network=predictor.network) == predictor
    assert np.array_equal(again.predict(scans), predictor.predict(scans))
    with pytest.raises(TypeError, match=r"expected Scans\(ranges, angles, poses\), got "):
        predictor.predict(scans.ranges)


def test_windows_are_predicted_in_batches(saved, scans):
    predictor, passes = saved[0], []
    hook = module_of(predictor).register_forward_hook(lambda _, inputs, __: passes.append(len(inputs[0])))
    many = Scans.stack([scans[number % 2] for number in range(5)])
    together = predictor.predict(many, batch=3)
    assert passes == [3, 2]
    hook.remove()
    assert np.allclose(predictor.predict(scans[1])[0], together[1], atol=1e-6)


@pytest.mark.parametrize("center", ["robot", "start"])
def test_a_network_of_fixed_obstacles_needs_a_map_that_does_not_move(saved, tmp_path, center):
    predictor, _ = saved
    save_trained(dataclasses.replace(predictor, has_fixed=True), tmp_path / "model")
    fixed = load_trained(tmp_path / "model")
    predictor.check_center(center)
    fixed.check_center((10.0, 10.0))
    with pytest.raises(ValueError, match=rf"trained with fixed obstacles: its map of 80 x 80 m .* got {center}"):
        fixed.check_center(center)
    refused = "trained with fixed obstacles" if center == "robot" else "expected robot or x, y"  # a stream has no start
    with pytest.raises(ValueError, match=refused):
        PredictionStream(fixed, np.linspace(-1, 1, 5), center=center)
    centered = dataclasses.replace(predictor, is_centered=True)
    centered.check_center("robot")
    with pytest.raises(ValueError, match=r"expected robot, got \(10\.0, 10\.0\), .* such as rooms"):
        centered.check_center((10.0, 10.0))


def test_a_miss_of_a_lidar_that_reaches_less_far_shows_free_space_up_to_its_range(saved):
    predictor = load_trained(ROOT / "reproduce" / "results" / "workstation-16000" / "exp4-convgru")
    poses = np.tile([25.0, 25.0, 0.0], (100, 1))
    misses = Scans(np.full((100, 90), np.inf), np.linspace(-0.78, 0.78, 90), poses).batched()
    distance = np.linalg.norm(predictor.grid.centers() - 25, axis=-1)
    for range_max_m, expected in ((10.0, 10.0), (30.0, 30.0), (100.0, 30.0)):
        near = predictor.with_range(range_max_m)
        seen = near.encoding.encode(misses, near.grid)[0, near.encoding.frames] == 0
        assert distance[seen.flatten()].max() == pytest.approx(expected, abs=predictor.grid.resolution_m)
        assert near.reach_m == expected
    assert saved[0].with_range(10.0) is saved[0]  # the paper's image shows hits only
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match=r"range_max_m: expected a positive range \[m\], got"):
            predictor.with_range(wrong)


def test_plain_smp_reads_the_same_weights(saved):
    predictor, directory = saved
    state = smp.from_pretrained(directory).state_dict()
    assert all(torch.equal(value, state[name]) for name, value in module_of(predictor).state_dict().items())


def test_saving_again_replaces_a_predictor_and_nothing_else(saved, tmp_path):
    predictor, _ = saved
    (tmp_path / "model").mkdir()
    save_trained(predictor, tmp_path / "model")
    (tmp_path / "model" / "notes.txt").write_text("of a user")
    with pytest.raises(ValueError, match=r"has files such as notes\.txt: move them elsewhere"):
        save_trained(predictor, tmp_path / "model", torch.float16)
    (tmp_path / "model" / "predictor.json").rename(tmp_path / "model" / "other.json")
    with pytest.raises(ValueError, match="exists and is no predictor: expected a new or an empty directory"):
        save_trained(predictor, tmp_path / "model")
    (tmp_path / "model" / "other.json").rename(tmp_path / "model" / "predictor.json")
    (tmp_path / "model" / "notes.txt").unlink()
    save_trained(predictor, tmp_path / "model", torch.float16)
    assert {path.name for path in tmp_path.iterdir()} == {"model"}
    assert {path.name for path in (tmp_path / "model").iterdir()} == {
        "README.md",
        "config.json",
        "model.safetensors",
        "predictor.json",
    }
    assert next(module_of(predictor).parameters()).dtype == torch.float32
    assert next(module_of(load_trained(tmp_path / "model")).parameters()).dtype == torch.float32


@pytest.mark.parametrize("name", ["model.safetensors", "predictor.json"])
@pytest.mark.parametrize("how", ["altered", "cut", "missing"])
def test_a_damaged_predictor_is_refused(saved, tmp_path, name, how):
    directory = tmp_path / "model"
    shutil.copytree(saved[1], directory)
    damage(directory / name, how)
    with pytest.raises(
        ValueError, match=r"differs from its checksum|lacks model\.safetensors|predictor\.json cannot be read"
    ):
        load_trained(directory)


def test_the_published_weights_predict_obstacles_where_beams_hit(scans):
    predictor = load_trained(PUBLISHED)
    free = predictor.predict(scans)
    assert free.shape == (2, 128, 128)
    hit = newest_hits(scans.batched(), predictor.grid) > 0
    assert free[hit].mean() < free[~hit].mean() - 0.2


def example_of(document, name):
    """The first Python code of a document that has a name."""
    codes = (part.split("```")[0] for part in (ROOT / document).read_text().split("```python")[1:])
    return next(code for code in codes if name in code)


@pytest.mark.slow
def test_the_example_of_the_readme_predicts_a_map_for_every_full_window(tmp_path, monkeypatch):
    (tmp_path / "examples").mkdir()
    log = dict(np.load(ROOT / "examples" / "rooms.npz"))
    first = {name: array[:105] if len(array.shape) and len(array) > 105 else array for name, array in log.items()}
    np.savez(tmp_path / "examples" / "rooms.npz", **first)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(example_of("README.md", "PredictionStream"), names)
    free = names["predicted"].free
    assert free.shape == (128, 128)
    assert 0 <= free.min() < 0.5 < free.max() <= 1
    assert (tmp_path / "map.png").is_file()


def test_the_example_with_arrays_gives_the_map_of_the_stream(monkeypatch):
    monkeypatch.chdir(ROOT)
    names = {}
    exec(example_of("docs/robot.md", "readings("), names)
    log = names["log"]
    stream = PredictionStream(load_predictor("indoor"), log["angles"], center="robot", range_max_m=30)
    maps = [stream.update(*scan) for scan in zip(log["ranges"][:100], log["poses"], log["stamps"], strict=False)]
    np.testing.assert_array_equal(names["free"][0], maps[-1].free)
