"""Networks of the page: ONNX files, and their entries in the menu."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import yaml

from repro.maps.encodings import kind_of
from repro.networks.onnx_files import CARD, OnnxNetwork
from repro.networks.predictor import Predictor
from repro.networks.weights import locate
from repro.system.errors import InputError

INPUTS = {  # of the encodings that assets/encodings.js draws
    "projection": "one image of the hits",
    "stack": "hits of {frames} times",
    "series": "hits and free pixels of {frames} times",
}


@dataclass(frozen=True)
class DemoNetwork:
    """A network of the page.

    Args:
        title: what it is, was trained for and reaches.
        predictor: the network as it was loaded.
        onnx: the network, from the input (1, C, H, W) to logits (1, 1, H, W).
    """

    title: str
    predictor: Predictor
    onnx: bytes


def demo_network(name: str, predictor: Predictor) -> DemoNetwork:
    """Return a network for the page, by the name or the path of its weights and what was loaded from there.

    Raises:
        InputError: the network was trained with fixed obstacles or with the robot in the middle, or the page cannot
            draw its encoding.
    """
    if predictor.has_fixed:
        raise InputError(f"{name} was trained with fixed obstacles, which the demo does not have")
    if predictor.is_centered:
        raise InputError(f"{name} takes the robot to be in the middle of the map, which it is not in the demo")
    kind = kind_of(predictor.encoding.name)
    if kind not in INPUTS:
        expected = ", ".join(INPUTS)
        raise InputError(
            f"{name} has the encoding {predictor.encoding.name}, expected {expected}: the page draws no other"
        )
    taken = INPUTS[kind].format(**vars(predictor.encoding))
    return DemoNetwork(f"{_described(name, predictor)}; sees {taken}", predictor, _onnx_of(predictor))


def _described(name: str, predictor: Predictor) -> str:
    """Return network, experiment and obstacle IoU from the model card, or the name of a network without a card."""
    card = locate(name) / "README.md"
    if isinstance(predictor.network, OnnxNetwork):
        text = predictor.network.metadata().get(CARD, "")
    else:
        text = card.read_text(encoding="utf-8") if card.is_file() else ""
    if not text.startswith("---"):
        return name
    (model,) = yaml.safe_load(text.split("---")[1])["model-index"]
    scores = {metric["type"]: metric["value"] for result in model["results"] for metric in result.get("metrics", ())}
    return model["name"] + (f", obstacle IoU {scores['obstacle_iou']:.2f}" if "obstacle_iou" in scores else "")


def _onnx_of(predictor: Predictor) -> bytes:
    """Return the ONNX file of a predictor, which is written if its network is one of torch."""
    if isinstance(predictor.network, OnnxNetwork):
        return predictor.network.content
    from repro.learning.networks.trained import export_onnx  # takes seconds

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.onnx"
        export_onnx(predictor, file)
        return file.read_bytes()
