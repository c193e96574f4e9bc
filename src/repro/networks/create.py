"""Creation and loading of networks: the architectures of segmentation-models-pytorch (smp) and our recurrent ones.

The paper uses four architectures of smp. Another one needs a file in conf/model and no code. An architecture outside
smp needs a class that can save itself (`PyTorchModelHubMixin`) and an entry in `OWN_ARCHITECTURES`.
"""

from inspect import signature
from pathlib import Path
from typing import Any, TypeAlias

import segmentation_models_pytorch as smp
import timm
from segmentation_models_pytorch.encoders import encoders

from repro.config import RECURRENT, ConfigError, Model
from repro.networks.convgru import ConvGRU
from repro.networks.convlstm import ConvLSTM

Network: TypeAlias = Any  # a torch.nn.Module with `save_pretrained`
OWN_ARCHITECTURES: dict[str, Any] = {"convgru": ConvGRU, "convlstm": ConvLSTM}
SERIES = ("in_channels", "frames")  # parameters that follow from the encoding


def create_network(model: Model, in_channels: int = 1, frames: int = 1) -> Network:
    """Create a network that maps encoded scans (B, C, H, W) to logits (B, 1, H, W).

    Paper: "Prediction Models". Encoder weights and channels are not stated: DEVIATIONS D9.

    Args:
        model: architecture, encoder and encoder weights.
        in_channels: channels of the encoding, C.
        frames: parts of the window with channels of their own; only a recurrent network uses it.

    Raises:
        ValueError: the architecture or one of its parameters is not allowed, or the encoder weights cannot be loaded.
    """
    architecture = model.architecture or model.name
    if architecture in OWN_ARCHITECTURES:
        try:
            series = {"frames": frames} if architecture in RECURRENT else {}
            return OWN_ARCHITECTURES[architecture](in_channels, **series, **model.parameters)
        except TypeError as error:
            raise ValueError(f"model.parameters={model.parameters}: {error}") from error
    if architecture not in smp_architectures():
        known = ", ".join([*smp_architectures(), *OWN_ARCHITECTURES])
        raise ValueError(f"model.architecture={architecture}: must be one of {known}")
    try:
        return smp.create_model(
            architecture,
            encoder_name=model.encoder_name,
            encoder_weights=model.encoder_weights,
            in_channels=in_channels,
            classes=1,
        )
    except Exception as error:
        if model.encoder_weights is None:
            raise
        raise ValueError(
            f"the {model.encoder_weights} weights of {model.encoder_name} cannot be loaded "
            f"({type(error).__name__}: {error}); connect to the internet once, or train from scratch with "
            "model.encoder_weights=null"
        ) from error


def smp_architectures() -> list[str]:
    """Return the names of the architectures of segmentation-models-pytorch."""
    return sorted(smp.MODEL_ARCHITECTURES_MAPPING)


def architecture_of(network: Network) -> str:
    """Return the name of the architecture of an own network, `smp` for a network of segmentation-models-pytorch."""
    return next((name for name, kind in OWN_ARCHITECTURES.items() if type(network) is kind), "smp")


def load_network(directory: Path, architecture: str) -> Network:
    """Load a network that `save_pretrained` wrote, with weights in float32.

    Args:
        directory: directory with config.json and model.safetensors.
        architecture: see `architecture_of`.
    """
    if architecture == "smp":
        return smp.from_pretrained(directory, strict=True).float()
    return OWN_ARCHITECTURES[architecture].from_pretrained(directory, strict=True).float()


def architecture_errors(model: Model) -> list[ConfigError]:
    """Return the config errors in the architecture, encoder and encoder weights of a network of smp."""
    architecture, name, weights = model.architecture or model.name, model.encoder_name, model.encoder_weights
    key = "model.architecture" if model.architecture else "model.name"
    if architecture in OWN_ARCHITECTURES:
        given = {"encoder_name": name, "encoder_weights": weights}
        expected = f"architecture {architecture} has an encoder of its own, leave it null"
        errors = [ConfigError(f"model.{key}", value, expected) for key, value in given.items() if value is not None]
        allowed = [each for each in signature(OWN_ARCHITECTURES[architecture]).parameters if each not in SERIES]
        expected = f"is not a parameter of {architecture}, known are {', '.join(allowed)}"
        unknown = {key: value for key, value in model.parameters.items() if key not in allowed}
        return errors + [ConfigError(f"model.parameters.{key}", value, expected) for key, value in unknown.items()]
    if model.parameters:
        expected = f"parameters are for networks of our own, {', '.join(OWN_ARCHITECTURES)}"
        return [ConfigError("model.parameters", model.parameters, expected)]
    if architecture not in smp_architectures():
        known = ", ".join([*smp_architectures(), *OWN_ARCHITECTURES])
        return [ConfigError(key, architecture, f"must be one of {known}")]
    if name is None:
        return [
            ConfigError("model.encoder_name", None, f"architecture {architecture} needs an encoder, such as mit_b0")
        ]
    if name.startswith("tu-") and not timm.is_model(name.removeprefix("tu-")):
        return [ConfigError("model.encoder_name", name, "must be tu- and a model of timm, such as tu-resnet18")]
    if name not in encoders and not name.startswith("tu-"):
        close = ", ".join(sorted(known for known in encoders if known[:3] == name[:3])[:8]) or "mit_b0"
        return [ConfigError("model.encoder_name", name, f"must be an encoder of smp, such as {close}")]
    pretrained = sorted(encoders.get(name, {}).get("pretrained_settings", {}))
    if weights is not None and name in encoders and weights not in pretrained:
        return [ConfigError("model.encoder_weights", weights, f"must be null or one of {', '.join(pretrained)}")]
    return []
