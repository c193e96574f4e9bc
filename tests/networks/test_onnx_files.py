"""ONNX files against the network of torch that they come from, and ONNX files that nobody should run."""

import json

import numpy as np
import onnx
import pytest
import torch
from huggingface_hub import PyTorchModelHubMixin
from onnx import TensorProto, numpy_helper

from repro.learning.networks.convgru import ConvGRU
from repro.learning.networks.convlstm import ConvLSTM
from repro.learning.networks.onnx_export import TOLERANCE
from repro.learning.networks.trained import TorchNetwork, export_onnx
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.series import Series
from repro.maps.statistics import Statistics
from repro.networks import onnx_files
from repro.networks.onnx_files import DESCRIPTION, INPUT, NO_CHECKSUM, checksum_of, read_onnx
from repro.networks.predictor import Predictor, load_predictor

pytestmark = pytest.mark.slow
STATISTICS = Statistics(4, {"hit_share": (0.1, 0.2, 0.3, 0.4, 0.5)})


class Small(torch.nn.Sequential, PyTorchModelHubMixin):
    """A network that saves itself."""


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Export a small predictor; return it and the file."""
    torch.manual_seed(0)
    network = Small(torch.nn.Conv2d(2, 4, 3, padding=1), torch.nn.ReLU(), torch.nn.Conv2d(4, 1, 1))
    predictor = Predictor(TorchNetwork(network), Series(1, 20.0), Grid(32, 40.0), STATISTICS)
    path = tmp_path_factory.mktemp("onnx") / "any name"
    assert export_onnx(predictor, path, "# Card") <= TOLERANCE
    return predictor, path


def changed(source, target, change) -> None:
    """Write a changed copy of a file, with a checksum that fits."""
    model = onnx.load(source)
    description = json.loads(model.metadata_props[0].value)
    change(model, description)
    model.metadata_props[0].value = json.dumps(description | {"sha256": NO_CHECKSUM})
    content = model.SerializeToString()
    target.write_bytes(content.replace(NO_CHECKSUM.encode(), checksum_of(content).encode()))


def test_a_file_holds_the_whole_predictor(exported):
    predictor, path = exported
    again = load_predictor(path)
    assert (again.encoding, again.grid, again.statistics) == (predictor.encoding, predictor.grid, STATISTICS)
    for batch in (1, 2, 7):
        images = np.random.default_rng(batch).integers(0, 256, (batch, 2, 32, 32), np.uint8)
        found, expected = (one.predict_images([images]) for one in (again, predictor))
        np.testing.assert_allclose(found, expected, atol=1e-4)
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    assert set(properties) == {DESCRIPTION, "repro.model_card"}
    assert properties["repro.model_card"] == "# Card"
    with pytest.raises(ValueError, match="the network is in ONNX Runtime"):
        export_onnx(again, path)


def centered(channels, frames):
    network = ConvGRU(channels, frames, centered=True)
    torch.nn.init.normal_(network.detail_from_distance.weight)
    return network


@pytest.mark.parametrize(("network", "name"), [(centered, "series2"), (ConvLSTM, "stack2")])
def test_a_recurrent_network_is_exported(tmp_path, network, name):
    torch.manual_seed(0)
    encoding = create_encoding(name, {"frames": 2})
    predictor = Predictor(TorchNetwork(network(encoding.channels, frames=2)), encoding, Grid(32, 50.0))
    assert export_onnx(predictor, tmp_path / "model.onnx") <= TOLERANCE
    images = np.random.default_rng(0).integers(0, 256, (3, encoding.channels, 32, 32), np.uint8)
    found = load_predictor(tmp_path).predict_images([images])
    np.testing.assert_allclose(found, predictor.predict_images([images]), atol=1e-4)


def test_a_network_that_differs_from_torch_is_not_written(exported, tmp_path, monkeypatch):
    predictor, _ = exported
    run = onnx_files.OnnxNetwork.__call__
    monkeypatch.setattr(onnx_files.OnnxNetwork, "__call__", lambda self, images: run(self, images) + 1e-2)
    with pytest.raises(ValueError, match=r"a probability differs by 0.002. from that of torch, expected at most"):
        export_onnx(predictor, tmp_path / "model.onnx")
    assert not list(tmp_path.iterdir())


def external(model, _) -> None:
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/hostname")


def within(model) -> onnx.GraphProto:
    """Return a graph in a branch that the network never takes."""
    inner = onnx.helper.make_graph([], "inner", [], [])
    node = onnx.helper.make_node("If", ["scans"], [], then_branch=inner, else_branch=inner)
    model.graph.node.append(node)
    return model.graph.node[-1].attribute[0].g


def in_a_branch(model, _) -> None:
    tensor = within(model).initializer.add(name="w", data_type=TensorProto.FLOAT, dims=[1])
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/hostname")


def in_a_function(model, _) -> None:
    tensor = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[1], data_location=TensorProto.EXTERNAL)
    tensor.external_data.add(key="location", value="/etc/hostname")
    node = onnx.helper.make_node("Constant", [], ["w"], value=tensor)
    function = onnx.helper.make_function("own", "f", [], ["w"], [node], [onnx.helper.make_opsetid("", 18)])
    model.functions.append(function)


def sparse(model, _) -> None:
    values = model.graph.sparse_initializer.add().values
    values.data_location = TensorProto.EXTERNAL
    values.external_data.add(key="location", value="/etc/hostname")


def endless(model, _) -> None:
    within(model).node.append(onnx.helper.make_node("Loop", [], [], body=onnx.helper.make_graph([], "body", [], [])))


def no_mapping(model, description) -> None:
    description["window"] = "steps"


def not_finite(model, _) -> None:
    weights = numpy_helper.to_array(model.graph.initializer[0]).copy()
    weights.flat[0] = np.nan
    model.graph.initializer[0].CopyFrom(numpy_helper.from_array(weights, model.graph.initializer[0].name))


def renamed(model, _) -> None:
    model.graph.input[0].name = "images"


def other_grid(_, description) -> None:
    description["grid"]["size_px"] = 64


def other_encoding(_, description) -> None:
    description["encoding"] = {"name": "projection", "parameters": {}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (external, "are in another file"),
        (in_a_branch, "are in another file"),
        (in_a_function, "are in another file"),
        (sparse, "are in another file"),
        (endless, "it has a loop"),
        (no_mapping, "must be a mapping"),
        (not_finite, "one map of finite logits"),
        (renamed, f"ONNX Runtime cannot run it .*{INPUT}"),
        (other_grid, "ONNX Runtime cannot run it .*invalid dimensions"),
        (other_encoding, "ONNX Runtime cannot run it .*invalid dimensions"),
    ],
)
def test_what_the_exporter_does_not_write_is_refused(exported, tmp_path, change, message):
    path = tmp_path / "changed.onnx"
    changed(exported[1], path, change)
    with pytest.raises(ValueError, match=rf"changed.onnx cannot be used \(.*{message}"):
        load_predictor(path)


@pytest.mark.parametrize("damage", ["empty", "text", "half", "a flipped byte", "of another program"])
def test_a_damaged_file_is_refused(exported, tmp_path, damage):
    content = bytearray(exported[1].read_bytes())
    if damage == "a flipped byte":
        weights = onnx.load(exported[1]).graph.initializer[0].raw_data
        content[content.find(weights) + 1] ^= 1
    path = tmp_path / "model.onnx"
    foreign = onnx.load(exported[1])
    del foreign.metadata_props[:]
    path.write_bytes(
        {"empty": b"", "text": b"hello", "half": content[: len(content) // 2], "a flipped byte": content,
         "of another program": foreign.SerializeToString()}[damage]
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"model.onnx cannot be used \(.*\): (train or )?export it"):
        read_onnx(path)


@pytest.mark.parametrize("suffix", [".ckpt", ".pt", ".pth"])
def test_a_checkpoint_of_torch_names_the_export(tmp_path, suffix):
    path = tmp_path / f"best{suffix}"
    path.write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"is a checkpoint of torch, .* task=export format=onnx"):
        load_predictor(path)
