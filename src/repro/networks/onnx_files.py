"""Networks in ONNX Runtime: one file with the network, its encoding, its grid and its model card.

The network maps encoded scans (B, C, H, W) in [0, 1] to logits (B, 1, H, W). The metadata of the file hold encoding,
grid, window and statistics (`repro.predictor`, JSON) with a checksum of the file, and the model card
(`repro.model_card`, Markdown). `learning.networks.onnx_export` writes such files.
"""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from repro.system.errors import InputError
from repro.system.files import check_regular, first_line
from repro.system.threads import count_threads

DESCRIPTION, CARD = "repro.predictor", "repro.model_card"
INPUT, OUTPUT = "scans", "logits"
CHECKSUM = re.compile(rb'"sha256": "([0-9a-f]{64})"')  # in the description
NO_CHECKSUM = "0" * 64  # stands for it in the file that it is of
LOOPS = re.compile(rb"\x22\x04(?:Loop|Scan)")  # operators that may never end, which no network of ours has
CHECKPOINTS = (".ckpt", ".pt", ".pth", ".safetensors", ".bin")
OUTSIDE = re.compile(rb"[\x00\x08]location")  # key of the path of weights in another file, which would be read


class OnnxNetwork:
    """A network in ONNX Runtime on the CPU, with the threads of `system.threads`.

    Args:
        content: the ONNX file.

    Raises:
        InputError: ONNX Runtime cannot run the file.
    """

    def __init__(self, content: bytes) -> None:
        self.content = content
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = count_threads()
        options.log_severity_level = 3  # errors
        options.add_session_config_entry("session.load_model_format", "ONNX")
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # classes of its own, without a common base
            raise InputError(f"ONNX Runtime cannot run it ({first_line(error)})") from error

    def __call__(self, images: np.ndarray) -> np.ndarray:
        """Return logits, (B, 1, H, W), of images, (B, C, H, W)."""
        try:
            (logits,) = self._session.run([OUTPUT], {INPUT: images})
        except Exception as error:  # classes of its own, without a common base
            raise InputError(f"ONNX Runtime cannot run it ({first_line(error)})") from error
        return logits

    def metadata(self) -> dict[str, str]:
        """Return the metadata of the file."""
        return dict(self._session.get_modelmeta().custom_metadata_map)

    def __reduce__(self) -> tuple[type, tuple[bytes]]:
        return OnnxNetwork, (self.content,)

    def __deepcopy__(self, _: dict) -> "OnnxNetwork":
        """Return the network itself: it does not change."""
        return self


def read_onnx(path: Path) -> tuple[OnnxNetwork, dict[str, Any]]:
    """Read an ONNX file that `learning.networks.onnx_export.write_onnx` wrote.

    Returns:
        the network and its description, see `networks.predictor.description_of`.

    Raises:
        InputError: the file is of another kind or damaged.
    """
    if path.suffix in CHECKPOINTS:
        run = "give the directory of the run, or export it with task=export format=onnx"
        raise InputError(f"{path}: is a checkpoint of torch, without the encoding of its input: {run}")
    try:
        check_regular(path)
        content = path.read_bytes()
        stored = CHECKSUM.search(content)
        if stored is None:
            raise InputError(f"its metadata lack {DESCRIPTION}")
        if checksum_of(content) != stored[1].decode():
            raise InputError("it differs from its checksum")
        if OUTSIDE.search(content):
            raise InputError("some of its weights are in another file")
        if LOOPS.search(content):
            raise InputError("it has a loop, which a network of this project has not")
        network = OnnxNetwork(content)
        description = json.loads(network.metadata()[DESCRIPTION])
        if not isinstance(description, dict):
            raise InputError(f"its {DESCRIPTION} is no mapping")
    except Exception as error:  # of the file system, ONNX Runtime or ours
        raise InputError(f"{path} cannot be used ({first_line(error)}): export it with task=export") from error
    return network, {name: value for name, value in description.items() if name not in ("sha256", "channels")}


def checksum_of(content: bytes) -> str:
    """Return the SHA-256 of a file, in which `NO_CHECKSUM` stands for the checksum that its description has."""
    stored = CHECKSUM.search(content)
    assert stored, "the description has a place for it"
    return hashlib.sha256(content[: stored.start(1)] + NO_CHECKSUM.encode() + content[stored.end(1) :]).hexdigest()
