"""Export of networks of torch to ONNX files, which `networks.onnx_files` reads."""

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import nn

from repro.networks.onnx_files import CARD, DESCRIPTION, INPUT, NO_CHECKSUM, OUTPUT, OnnxNetwork, checksum_of
from repro.system.errors import InputError
from repro.system.files import replacing

# largest difference of a probability of free from that of torch; 4e-4 was measured on images of one color (ConvLSTM)
TOLERANCE = 1e-3


def write_onnx(path: Path, network: nn.Module, channels: int, description: dict[str, Any], card: str = "") -> float:
    """Write a network as an ONNX file, atomically, if it gives the same probabilities as torch.

    Args:
        path: the file to create or replace.
        network: a network of torch, which stays as it is.
        channels: images of its input, C.
        description: see `networks.predictor.description_of`.
        card: the model card.

    Returns:
        the largest difference of a probability from that of torch.

    Raises:
        InputError: a probability differs from that of torch by more than `TOLERANCE`.
    """
    network, size = copy.deepcopy(network).cpu().float().eval(), description["grid"]["size_px"]
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
    content = _content(program.model_proto, description, card)
    difference = _difference(network, OnnxNetwork(content), example)
    if not difference <= TOLERANCE:
        raise InputError(
            f"{path} is not written: in ONNX Runtime a probability differs by {difference:.2g} from that of torch, "
            f"expected at most {TOLERANCE:g}"
        )
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return difference


def _content(model: onnx.ModelProto, description: dict[str, Any], card: str) -> bytes:
    """Return the serialized model with its checksum, without the notes of the exporter on its source."""
    for part in (model, model.graph, *model.graph.node, *model.graph.value_info):
        del part.metadata_props[:]
    text = json.dumps(description | {"sha256": NO_CHECKSUM})
    onnx.helper.set_model_props(model, {DESCRIPTION: text, CARD: card})
    content = model.SerializeToString(deterministic=True)
    return content.replace(NO_CHECKSUM.encode(), checksum_of(content).encode(), 1)


def _difference(network: nn.Module, exported: OnnxNetwork, example: torch.Tensor) -> float:
    """Return the largest difference of a probability over inputs of several batch sizes, uniform, white and black."""
    inputs = [example, example[:1], torch.cat([example.round(), torch.ones_like(example[:1])]), 0 * example[:1]]
    with torch.inference_mode():
        pairs = [(network(images), torch.from_numpy(exported(images.numpy()))) for images in inputs]
    differences = [float((one.sigmoid() - other.sigmoid()).abs().max()) for one, other in pairs]
    return math.nan if np.isnan(differences).any() else max(differences)
