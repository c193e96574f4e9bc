"""Creation and loading of networks: the architectures of segmentation-models-pytorch (smp) and our recurrent ones.

The paper uses four architectures of smp. Another one needs a file in conf/model and no code. An architecture outside
smp needs a class that can save itself (`PyTorchModelHubMixin`) and an entry in `OWN_ARCHITECTURES`, or in another
package an entry point `repro.architectures`.
"""

import copy
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

from repro.learning.networks.convgru import ConvGRU
from repro.learning.networks.convlstm import ConvLSTM
from repro.runs.model import NETWORKS, Model
from repro.system.errors import InputError
from repro.system.fields import ConfigError
from repro.system.plugins import plugins

OURS = {"convgru": ConvGRU, "convlstm": ConvLSTM}
OWN_ARCHITECTURES: dict[str, Any] = {**OURS, **plugins("repro.architectures", (*OURS, *NETWORKS))}
SERIES_CHANNELS = 10  # of the input with which the parameters of an own architecture are tried


def create_network(model: Model, in_channels: int = 1, frames: int = 1) -> nn.Module:
    """Create a network that maps encoded scans (B, C, H, W) to logits (B, 1, H, W).

    Paper: "Prediction Models". Encoder weights and channels are not stated: DEVIATIONS D9.

    Args:
        model: architecture, encoder and encoder weights.
        in_channels: channels of the encoding, C.
        frames: parts of the window with channels of their own, for a class that has this parameter.

    Raises:
        InputError: the architecture or one of its parameters is not allowed, or the encoder weights cannot be loaded.
    """
    architecture = model.kind
    if architecture in OWN_ARCHITECTURES:
        try:
            kind = OWN_ARCHITECTURES[architecture]
            series = {"frames": frames} if "frames" in signature(kind).parameters else {}
            return kind(in_channels, **series, **model.parameters)
        except TypeError as error:
            raise InputError(str(error)) from error
    smp_networks = _smp_networks()
    if architecture not in smp_networks.ARCHITECTURES:
        raise InputError(f"model.architecture={architecture}: must be one of {_known(smp_networks)}")
    return smp_networks.create_smp_network(architecture, model, in_channels)


def check_interface(network: nn.Module, in_channels: int, size_px: int = 64) -> None:
    """Check that a network on the CPU can be saved and maps images (B, C, H, W) to logits (B, 1, H, W).

    Args:
        network: the network, which stays unchanged.
        in_channels: channels of the images, C.
        size_px: pixels along one side of the two images of the check.

    Raises:
        InputError: it has no `save_pretrained`, or its output is of another kind or shape.
    """
    if not isinstance(network, PyTorchModelHubMixin):
        name = type(network).__name__
        raise InputError(f"the network {name} must save itself: make it a subclass of PyTorchModelHubMixin, too")
    images = torch.zeros(2, in_channels, size_px, size_px)
    with torch.inference_mode(), torch.random.fork_rng(devices=[]):
        output = copy.deepcopy(network).eval()(images)
    got = tuple(output.shape) if isinstance(output, Tensor) else type(output).__name__
    expected = (2, 1, size_px, size_px)
    if got != expected:
        raise InputError(
            f"the network must map images (B, {in_channels}, H, W) to logits (B, 1, H, W): expected {expected} of "
            f"{tuple(images.shape)}, got {got}"
        )


def architecture_of(network: object) -> str:
    """Return the name of the architecture of an own network, `smp` for a network of segmentation-models-pytorch."""
    return next((name for name, kind in OWN_ARCHITECTURES.items() if type(network) is kind), "smp")


def load_network(directory: Path, architecture: str) -> nn.Module:
    """Load a network that `save_pretrained` wrote, with weights in float32.

    Args:
        directory: directory with config.json and model.safetensors.
        architecture: see `architecture_of`.

    Raises:
        InputError: the architecture is unknown, or the network does not end in logits.
    """
    if architecture == "smp":
        return _smp_networks().load_smp_network(directory).float()
    if architecture not in OWN_ARCHITECTURES:
        raise InputError(f"architecture={architecture}: must be one of smp, {', '.join(OWN_ARCHITECTURES)}")
    return OWN_ARCHITECTURES[architecture].from_pretrained(directory, strict=True).float()


def replace_slow_modules(network: nn.Module) -> None:
    """Replace modules of smp in place by those that compute the same in less time."""
    if architecture_of(network) == "smp":
        _smp_networks().replace_slow_modules(network)


def architecture_errors(model: Model) -> list[ConfigError]:
    """Return the config errors in the architecture of a network, its parameters, encoder and encoder weights."""
    architecture, name, weights = model.kind, model.encoder_name, model.encoder_weights
    key = "model.architecture" if model.architecture else "model.name"
    if architecture in OWN_ARCHITECTURES:
        given = {"encoder_name": name, "encoder_weights": weights}
        expected = f"architecture {architecture} has an encoder of its own, leave it null"
        errors = [ConfigError(f"model.{key}", value, expected) for key, value in given.items() if value is not None]
        try:
            with torch.device("meta"):  # which takes no memory
                create_network(model, SERIES_CHANNELS, SERIES_CHANNELS)
        except (ValueError, RuntimeError) as error:
            errors.append(ConfigError("model.parameters", model.parameters, str(error)))
        return errors
    if model.parameters:
        known = ", ".join(OWN_ARCHITECTURES)
        expected = f"parameters are for the architectures {known}: set model.architecture, or install its package"
        return [ConfigError("model.parameters", model.parameters, expected)]
    smp_networks = _smp_networks()
    if architecture not in smp_networks.ARCHITECTURES:
        return [ConfigError(key, architecture, f"must be one of {_known(smp_networks)}, in lower case")]
    return smp_networks.encoder_errors(model)


def _smp_networks() -> ModuleType:
    from repro.learning.networks import smp_networks  # imports smp and timm, which our own networks do not need

    return smp_networks


def _known(smp_networks: ModuleType) -> str:
    return ", ".join([*smp_networks.ARCHITECTURES, *OWN_ARCHITECTURES])
