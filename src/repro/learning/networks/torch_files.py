"""Networks of torch on disk: a directory in the format of segmentation-models-pytorch, and predictor.json beside it.

predictor.json has the architecture, the description of the predictor, and a checksum of all files.
"""

import contextlib
import copy
import hashlib
import io
import json
import os
import re
from pathlib import Path
from typing import Any

import torch
from huggingface_hub import PyTorchModelHubMixin
from safetensors import SafetensorError
from torch import nn

from repro.learning.networks.create import architecture_of, load_network
from repro.networks.weights import ONNX
from repro.system.errors import InputError
from repro.system.files import read_mapping, replacing_directory, sha256, write_json

DESCRIPTION, NETWORK, WEIGHTS, CARD = "predictor.json", "config.json", "model.safetensors", "README.md"
OWN_FILES = (DESCRIPTION, NETWORK, WEIGHTS, CARD, ONNX)  # the last is made from the others


def write_torch(directory: Path, network: nn.Module, dtype: torch.dtype, description: dict[str, Any]) -> str:
    """Write a network and its description to a directory, atomically.

    Args:
        directory: directory to create, or to replace if it is empty or holds a predictor.
        network: a network of torch, which stays as it is.
        dtype: type of the stored weights.
        description: see `networks.predictor.description_of`.

    Returns:
        the SHA-256 checksum of the weights file.

    Raises:
        InputError: there is something else.
        OSError: the disk is full, for example.
    """
    is_other = directory.exists() and not (directory / DESCRIPTION).is_file()
    if is_other and (not directory.is_dir() or any(directory.iterdir())):
        raise InputError(f"{directory} exists and is no predictor: expected a new or an empty directory")
    with replacing_directory(directory, OWN_FILES.__contains__) as new:
        assert isinstance(network, PyTorchModelHubMixin), "see `create.check_interface`"
        try:
            copy.deepcopy(network).cpu().to(dtype).save_pretrained(new)
        except SafetensorError as error:
            if number := re.search(r"os error (\d+)", str(error)):
                raise OSError(int(number[1]), os.strerror(int(number[1]))) from error
            raise
        content = {"architecture": architecture_of(network), **description}
        write_json(new / DESCRIPTION, content | {"sha256": _checksum(content, new)})
        return sha256(new / WEIGHTS)


def read_torch(directory: Path) -> tuple[nn.Module, dict[str, Any]]:
    """Read the network and the description that `write_torch` wrote.

    Raises:
        InputError: files are missing, differ from the checksum, or hold no network.
    """
    content = read_mapping(directory / DESCRIPTION, f"{directory} must be written by task=train or task=export")
    expected = content.pop("sha256", None)
    missing = [name for name in (NETWORK, WEIGHTS) if not (directory / name).is_file()]
    if missing or _checksum(content, directory) != expected:
        problem = f"lacks {', '.join(missing)}" if missing else "differs from its checksum"
        raise InputError(f"{directory} {problem}: restore its files, or train or export it again")
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # huggingface_hub prints the source of the weights
            return load_network(directory, content["architecture"]), content
    except Exception as error:  # of smp, safetensors or ours: the files are complete, and hold no network
        raise InputError(f"{directory} cannot be used ({error}): train or export it again") from error


def _checksum(content: dict[str, Any], directory: Path) -> str:
    """Return one SHA-256 of the description, the configuration and the weights of a predictor."""
    files = {name: sha256(directory / name) for name in (NETWORK, WEIGHTS)}
    return hashlib.sha256(json.dumps({**content, "files": files}, sort_keys=True).encode()).hexdigest()
