"""Predictors whose network is one of torch: runs, and directories that `save_trained` wrote.

The directory has the format of segmentation-models-pytorch (`smp.from_pretrained` can read it, except for an own
architecture) and one additional file, predictor.json, with the encoding of the scans, the grid of the map, and the
statistics and the window of the training scans, see `torch_files`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from repro.learning.networks.onnx_export import write_onnx
from repro.learning.networks.torch_files import DESCRIPTION, read_torch, write_torch
from repro.networks.predictor import Predictor, create_predictor, description_of
from repro.networks.weights import locate
from repro.runs.devices import few_threads
from repro.system.errors import InputError

LARGEST_CHECKED_PX = 512  # side of the images with which a network is checked, since a file may claim any


@dataclass(frozen=True)
class TorchNetwork:
    """A network of torch as a function of arrays, see `networks.predictor.Network`.

    On the CPU, one thread computes unless the user has chosen more, see `system.threads`.

    Args:
        module: the network, in evaluation mode.
        device: cpu or cuda.
    """

    module: nn.Module
    device: str = "cpu"

    def __post_init__(self) -> None:
        self.module.to(self.device).eval()

    @torch.inference_mode()
    def __call__(self, images: np.ndarray) -> np.ndarray:
        with few_threads():
            return self.module(torch.from_numpy(images).to(self.device)).numpy(force=True)


def load_trained(weights: str | Path, device: str = "cpu") -> Predictor:
    """Load a predictor with weights of torch, in float32.

    Args:
        weights: a run, a directory that `save_trained` wrote, or one of the names that `load_predictor` takes.
        device: cpu or cuda.

    Raises:
        InputError: there are no such weights, their files differ from the saved checksum, or the network is not one
            from encoded scans to one map of finite logits.
    """
    path = locate(weights)
    if not (path / DESCRIPTION).is_file() and (path / "model").is_dir():
        path = path / "model"
    if path.is_file():
        raise InputError(f"{path}: expected weights of torch, a run or a directory with {DESCRIPTION}, got a file")
    module, description = read_torch(path)
    if not all(torch.isfinite(values).all() for values in module.state_dict().values()):
        raise InputError(f"{path} cannot be used (some of its weights are not finite): train or export it again")
    return create_predictor(TorchNetwork(module, device), description, path, LARGEST_CHECKED_PX)


def module_of(predictor: Predictor) -> nn.Module:
    """Return the module of a predictor with a network of torch.

    Raises:
        InputError: its network is in ONNX Runtime.
    """
    if not isinstance(predictor.network, TorchNetwork):
        raise InputError("the network is in ONNX Runtime: expected a predictor of torch, see `load_trained`")
    return predictor.network.module


def save_trained(predictor: Predictor, directory: Path | str, dtype: torch.dtype = torch.float32) -> str:
    """Write a predictor to a directory, atomically.

    Args:
        predictor: a predictor with a network of torch.
        directory: directory to create, or to replace if it is empty or holds a predictor.
        dtype: type of the stored weights.

    Returns:
        the SHA-256 checksum of the weights file.

    Raises:
        InputError: the network is in ONNX Runtime, or the directory holds something else.
    """
    return write_torch(Path(directory), module_of(predictor), dtype, description_of(predictor))


def export_onnx(predictor: Predictor, path: Path | str, card: str = "") -> float:
    """Write a predictor to an ONNX file, see `export.write_onnx`.

    Args:
        predictor: a predictor with a network of torch.
        path: the file to create or replace.
        card: the model card, which the metadata of the file hold.

    Returns:
        the largest difference of a probability from that of torch.

    Raises:
        InputError: the network is in ONNX Runtime already, or ONNX Runtime gives other maps than torch.
    """
    description = description_of(predictor)
    return write_onnx(Path(path), module_of(predictor), predictor.encoding.channels, description, card)
