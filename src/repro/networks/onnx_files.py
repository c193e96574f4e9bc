"""Predictors as ONNX files: one file with the network, its encoding, its grid and its model card.

The network maps encoded scans (B, C, H, W) in [0, 1] to logits (B, 1, H, W). The metadata of the file hold
encoding, grid, window and statistics (`repro.predictor`, JSON) and the model card (`repro.model_card`, Markdown).
"""

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import onnx
import onnxruntime
import torch
from onnx import ModelProto, TensorProto
from torch import Tensor, nn

from repro.system.devices import chosen_threads
from repro.system.errors import InputError
from repro.system.files import first_line, replacing

DESCRIPTION, CARD = "repro.predictor", "repro.model_card"
INPUT, OUTPUT = "scans", "logits"
# largest difference of a probability of free from that of torch; 4e-4 was measured on images of one color (ConvLSTM)
TOLERANCE = 1e-3


class OnnxNetwork(nn.Module):
    """A network in ONNX Runtime on the CPU, with `chosen_threads`.

    Args:
        content: the ONNX file.

    Raises:
        ValueError: ONNX Runtime cannot run the file.
    """

    def __init__(self, content: bytes) -> None:
        super().__init__()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = chosen_threads()
        options.log_severity_level = 3  # errors
        try:
            self.session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # classes of its own, without a common base
            raise InputError(f"ONNX Runtime cannot run it ({first_line(error)})") from error

    def forward(self, images: Tensor) -> Tensor:
        """Return logits, (B, 1, H, W), of images, (B, C, H, W)."""
        try:
            (logits,) = self.session.run([OUTPUT], {INPUT: images.cpu().numpy()})
        except Exception as error:  # classes of its own, without a common base
            raise InputError(f"ONNX Runtime cannot run it ({first_line(error)})") from error
        return torch.from_numpy(logits)


def write_onnx(path: Path, network: nn.Module, description: dict[str, Any], card: str = "") -> float:
    """Write a network as an ONNX file, atomically, if it gives the same probabilities as torch.

    Args:
        path: the file to create or replace.
        network: a network of torch.
        description: see `Predictor.save`, and the `channels` of the encoding.
        card: the model card.

    Returns:
        the largest difference of a probability from that of torch.

    Raises:
        ValueError: a probability differs from that of torch by more than `TOLERANCE`.
    """
    network = network.cpu().float().eval()
    channels, size = description["channels"], description["grid"]["size_px"]
    example = torch.rand(2, channels, size, size, generator=torch.Generator().manual_seed(0))
    program = torch.onnx.export(
        network,
        (example,),
        dynamo=True,
        external_data=False,
        verbose=False,
        input_names=[INPUT],
        output_names=[OUTPUT],
        dynamic_shapes=({0: torch.export.Dim("batch", min=1, max=4096)},),
    )
    assert program is not None, "with dynamo"
    model = program.model_proto
    del model.metadata_props[:]
    text = json.dumps(description | {"sha256": _checksum(model, description)}, sort_keys=True)
    onnx.helper.set_model_props(model, {DESCRIPTION: text, CARD: card})
    content = model.SerializeToString()
    difference = _difference(network, OnnxNetwork(content), example)
    if not difference <= TOLERANCE:
        raise InputError(
            f"{path} is not written: in ONNX Runtime a probability differs by {difference:.2g} from that of torch, "
            f"expected at most {TOLERANCE:g}"
        )
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return difference


def read_onnx(path: Path) -> tuple[OnnxNetwork, dict[str, Any]]:
    """Read an ONNX file that `write_onnx` wrote.

    Returns:
        the network and its description.

    Raises:
        ValueError: the file is of another kind or damaged.
    """
    try:
        content = path.read_bytes()
        model = onnx.load_model_from_string(content)
        description = _description(model)
        checksum = description.pop("sha256", None)
        if _checksum(model, description) != checksum:
            raise InputError("it differs from its checksum")
        _check_tensors(model)
        network = OnnxNetwork(content)
    except Exception as error:  # of protobuf, onnx, ONNX Runtime or ours
        raise InputError(f"{path} cannot be used ({first_line(error)}): export it with task=export") from error
    return network, description


def _description(model: ModelProto) -> dict[str, Any]:
    properties = {each.key: each.value for each in model.metadata_props}
    if DESCRIPTION not in properties:
        raise InputError(f"its metadata lack {DESCRIPTION}")
    return json.loads(properties[DESCRIPTION])


def _check_tensors(model: ModelProto) -> None:
    """Refuse weights in other files, which would be read."""
    tensors = [*model.graph.initializer, *(attribute.t for node in model.graph.node for attribute in node.attribute)]
    if outside := [tensor.name for tensor in tensors if tensor.data_location == TensorProto.EXTERNAL]:
        raise InputError(f"its weights {outside[0]} are in another file")


def _difference(network: nn.Module, exported: OnnxNetwork, example: Tensor) -> float:
    """Return the largest difference of a probability over inputs of several batch sizes, uniform, white and black."""
    inputs = [example, example[:1], torch.cat([example.round(), torch.ones_like(example[:1])]), 0 * example[:1]]
    with torch.inference_mode():
        differences = [float((network(each).sigmoid() - exported(each).sigmoid()).abs().max()) for each in inputs]
    return math.nan if any(map(math.isnan, differences)) else max(differences)


def _checksum(model: ModelProto, description: dict[str, Any]) -> str:
    """Return the SHA-256 of the graph and the description."""
    graph = model.graph.SerializeToString(deterministic=True)
    return hashlib.sha256(graph + json.dumps(description, sort_keys=True).encode()).hexdigest()
