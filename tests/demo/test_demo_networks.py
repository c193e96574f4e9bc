import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from conftest import ROOT
from onnx import TensorProto, helper, numpy_helper

from repro.demo import networks, page
from repro.demo.runtime import Runtime
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.networks.create import create_network
from repro.networks.model import paper_model
from repro.networks.predictor import Predictor
from repro.world_config import read_world

PAGE_GRID = Grid(32, 50.0)


def matrix_model(weights):
    """Return an ONNX model that multiplies its input (1, K) by weights (K, K)."""
    size = len(weights)
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size]) for name in "xy"]
    nodes = [helper.make_node("MatMul", ["x", "w"], ["y"])]
    graph = helper.make_graph(nodes, "g", values[:1], values[1:], [numpy_helper.from_array(weights, "w")])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10).SerializeToString()


def test_float16_weights_take_half_the_space_and_give_the_same_output():
    weights = np.random.default_rng(0).normal(size=(64, 64)).astype(np.float16).astype(np.float32)
    whole, half = matrix_model(weights), networks.with_float16_weights(matrix_model(weights))
    assert len(half) < 0.6 * len(whole)
    onnx.checker.check_model(onnx.load_from_string(half), full_check=True)
    given = {"x": np.ones((1, 64), np.float32)}
    outputs = [onnxruntime.InferenceSession(each).run(None, given)[0] for each in (whole, half)]
    np.testing.assert_array_equal(*outputs)  # the weights are exact in float16


@pytest.fixture
def saved(tmp_path):
    """Return a function that saves an untrained network with an encoding."""

    def save(directory, name, **parameters):
        encoding = create_encoding(name, parameters)
        torch.manual_seed(0)
        network = create_network(paper_model("unet"), encoding.channels).eval()
        Predictor(network, encoding, Grid(32, 50.0)).save(tmp_path / directory)
        return tmp_path / directory

    return save


@pytest.mark.slow
def test_a_saved_network_is_loaded_with_its_encoding_and_grid(saved):
    loaded = networks.load_demo_network(saved("exp2-unet", "projection"))
    assert (loaded.title, loaded.experiment, loaded.grid) == ("U-Net, experiment 2", "2", PAGE_GRID)
    assert loaded.encoding == {"name": "projection", "parameters": {"decay": True, "oldest_gray": 0.8}}


@pytest.mark.parametrize(
    ("place", "decay", "named"),
    [
        ("exp1-unet-seed1", True, ("U-Net, experiment 1", "1")),
        ("expmy-own-unet", True, ("U-Net, experiment my-own", "my-own")),
        ("exp4-unet-projection-no-decay-seed1", False, ("U-Net, no decay, experiment 4", "4")),
        ("runs/exp3/unet/projection/seed0/model", True, ("U-Net, experiment 3", "3")),
        ("mine", True, ("U-Net, mine", None)),
    ],
)
def test_a_network_is_named_by_its_directory(place, decay, named, tmp_path):
    encoding = create_encoding("projection", {"decay": decay, "oldest_gray": 0.8})
    predictor = Predictor(create_network(paper_model("unet")), encoding, PAGE_GRID)
    assert networks._names(tmp_path / place, predictor) == named


def test_modules_come_after_those_they_import():
    modules = page.link_modules(Runtime("// runtime", b""))
    order = list(modules)
    assert {path.name for path in page.ASSETS.glob("*.js")} - {"loader.js"} == set(order) - {"ort.mjs"}
    for name, source in modules.items():
        assert all(order.index(other) < order.index(name) for other in page.IMPORTS.findall(source))


def world(name):
    return read_world(ROOT / "conf" / "world" / f"{name}.yaml")


def network(title="Net", grid=PAGE_GRID, steps=100, step_s=0.1, content=b""):
    return networks.DemoNetwork(title, None, {}, grid, steps, step_s, content)


def test_a_page_that_is_too_large_is_refused():
    large = network("Large", content=np.random.default_rng(0).bytes(20_000_000))
    with pytest.raises(ValueError, match=r"has 26.* MB, at most 25 are allowed.*Large 20.0 MB"):
        page.render([large], Runtime("", b""), world("paper"))


@pytest.mark.parametrize("name", ["drive", "office", "turned"])
def test_a_world_that_the_page_cannot_simulate_is_refused(name):
    content = world("paper" if name == "turned" else name)
    if name == "turned":
        content["experiments"]["1"]["motion"]["turned_rad"] = 1.0
    with pytest.raises(ValueError, match=r"cannot simulate experiment .*: use world=paper"):
        page.render([network()], Runtime("", b""), content)


@pytest.mark.parametrize(
    ("grid", "steps", "step_s", "problem"),
    [
        (Grid(32, 25.0), 100, 0.1, "Other predicts maps of 25 m from 100 steps of 0.1 s, this page needs maps of 50 m"),
        (Grid(32, 50.0), 50, 0.1, "Other predicts maps of 50 m from 50 steps of 0.1 s, .* from 100 steps of 0.1 s"),
    ],
)
def test_a_network_of_other_maps_or_windows_is_refused(grid, steps, step_s, problem):
    with pytest.raises(ValueError, match=f"demo.networks: {problem}"):
        page.render([network(), network("Other", grid, steps, step_s)], Runtime("", b""), world("paper"))


def test_a_network_of_fixed_obstacles_is_refused():
    directory = ROOT / "reproduce" / "results" / "office-8000" / "exppeople-convgru"
    with pytest.raises(ValueError, match="was trained with fixed obstacles, which the demo does not have"):
        networks.load_demo_network(directory)
