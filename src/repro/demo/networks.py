"""Networks for the page: ONNX with weights stored as float16, checked against PyTorch."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from repro.learning.networks.export import TOLERANCE
from repro.learning.networks.trained import export_onnx, load_trained
from repro.maps.encodings import kind_of
from repro.networks.onnx_files import OnnxNetwork
from repro.networks.predictor import Predictor
from repro.system.errors import InputError

DRAWN_ENCODINGS = ("projection", "stack", "series")  # those that assets/encodings.js draws
SMALLEST = 256  # values of a tensor that is stored as float16


@dataclass(frozen=True)
class DemoNetwork:
    """A network of the page.

    Args:
        title: its name.
        predictor: the network as it was loaded.
        onnx: the network, from the input (1, C, H, W) to logits (1, 1, H, W).
    """

    title: str
    predictor: Predictor
    onnx: bytes


def load_demo_network(title: str) -> DemoNetwork:
    """Load a network for the page by the name or the path of its weights, see `load_trained`.

    Raises:
        InputError: there is no such predictor of torch, it was trained with fixed obstacles, the page cannot draw its
            encoding, or float16 weights change its output by more than 0.001.
    """
    predictor = load_trained(title)
    if predictor.has_fixed:
        raise InputError(f"{title} was trained with fixed obstacles, which the demo does not have")
    if predictor.is_centered:
        raise InputError(f"{title} takes the robot to be in the middle of the map, which it is not in the demo")
    name = predictor.encoding.name
    if kind_of(name) not in DRAWN_ENCODINGS:
        expected = ", ".join(DRAWN_ENCODINGS)
        raise InputError(f"{title} has the encoding {name}, expected {expected}: the page draws no other")
    content = with_float16_weights(_onnx_of(predictor))
    _check(content, predictor, title)
    return DemoNetwork(title, predictor, content)


def with_float16_weights(content: bytes) -> bytes:
    """Store the large float32 weights of an ONNX model as float16; ONNX Runtime converts them back when it loads them.

    Raises:
        InputError: a weight is too large for float16.
    """
    model = onnx.load_from_string(content)
    graph, casts = model.graph, []
    for tensor in graph.initializer:
        if tensor.data_type != TensorProto.FLOAT or np.prod(tensor.dims) < SMALLEST:
            continue
        name, values = tensor.name, numpy_helper.to_array(tensor)
        if np.abs(values).max() > np.finfo(np.float16).max:
            raise InputError(f"weights {name}: expected values within float16, the largest is {np.abs(values).max()}")
        tensor.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}.float16"))
        casts.append(helper.make_node("Cast", [f"{name}.float16"], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:], graph.value_info[:]
    graph.node.extend(nodes)
    return model.SerializeToString()


def _onnx_of(predictor: Predictor) -> bytes:
    """Return the ONNX file of a predictor of torch."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.onnx"
        export_onnx(predictor, file)
        return file.read_bytes()


def _check(content: bytes, predictor: Predictor, title: str) -> None:
    """Compare with PyTorch on images of random gray values of which most are white."""
    rng = np.random.default_rng(0)
    shape = (1, predictor.encoding.channels, predictor.grid.size_px, predictor.grid.size_px)
    images = np.where(rng.random(shape) < 0.1, rng.integers(0, 256, shape), 255).astype(np.uint8)
    exported = replace(predictor, network=OnnxNetwork(content))
    error = float(np.abs(exported.predict_images([images]) - predictor.predict_images([images])).max())
    if not error <= TOLERANCE:
        raise InputError(f"{title}: ONNX with float16 weights differs from PyTorch by {error:.4f}, over {TOLERANCE}")
