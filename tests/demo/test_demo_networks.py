import numpy as np
import onnx
import onnxruntime
import pytest
from conftest import ROOT
from onnx import TensorProto, helper, numpy_helper

from repro.demo import networks, page
from repro.demo.runtime import Runtime
from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork, save_trained
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.networks.predictor import Predictor
from repro.runs.model import paper_model
from repro.worlds.spec import WorldFile, read_world

PAGE_GRID = Grid(32, 50.0)
PROJECTION = create_encoding("projection", {"decay": True, "oldest_gray": 0.8})


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


@pytest.mark.slow
def test_a_saved_network_is_loaded_with_its_encoding_and_grid(tmp_path):
    network = TorchNetwork(create_network(paper_model("unet")))
    save_trained(Predictor(network, PROJECTION, PAGE_GRID), tmp_path / "unet")
    loaded = networks.load_demo_network(str(tmp_path / "unet"))
    assert (loaded.title, loaded.predictor.grid) == (str(tmp_path / "unet"), PAGE_GRID)
    assert loaded.predictor.encoding == PROJECTION


def world(name):
    return WorldFile.parse(read_world(ROOT / "conf" / "world" / f"{name}.yaml")).specs


def network(title="Net", grid=PAGE_GRID, steps=100, step_s=0.1):
    predictor = Predictor(
        TorchNetwork(create_network(paper_model("unet"))), PROJECTION, grid, steps=steps, step_s=step_s
    )
    return networks.DemoNetwork(title, predictor, b"")


@pytest.mark.parametrize("name", ["drive", "office"])
def test_a_world_that_the_page_cannot_show_is_refused(name):
    with pytest.raises(ValueError, match=r"cannot show experiment .*: use world=paper"):
        page.render([network()], Runtime("", b""), world(name))


@pytest.mark.parametrize(
    ("grid", "steps", "problem"),
    [
        (Grid(32, 25.0), 100, "Other predicts maps of 25 m from 100 steps of 0.1 s, this page needs maps of 50 m"),
        (Grid(32, 50.0), 50, "Other predicts maps of 50 m from 50 steps of 0.1 s, .* from 100 steps of 0.1 s"),
    ],
)
def test_a_network_of_other_maps_or_windows_is_refused(grid, steps, problem):
    with pytest.raises(ValueError, match=f"demo.networks: {problem}"):
        page.render([network(), network("Other", grid, steps)], Runtime("", b""), world("paper"))


def test_a_network_of_fixed_obstacles_is_refused():
    with pytest.raises(ValueError, match="was trained with fixed obstacles, which the demo does not have"):
        networks.load_demo_network("reproduce/results/office-8000/exppeople-convgru")
