"""The architectures of segmentation-models-pytorch (smp); imported only where one is used, which takes seconds."""

from pathlib import Path
from typing import Any

import segmentation_models_pytorch as smp
import timm
import torch
from segmentation_models_pytorch.base.modules import Activation
from segmentation_models_pytorch.decoders.segformer.decoder import SegformerDecoder
from segmentation_models_pytorch.decoders.unet.decoder import UnetDecoderBlock
from segmentation_models_pytorch.encoders import encoders
from torch import Tensor
from torch.nn import functional as F

from repro.runs.model import Model
from repro.system.errors import InputError
from repro.system.fields import ConfigError
from repro.system.files import read_mapping

ARCHITECTURES = sorted(smp.MODEL_ARCHITECTURES_MAPPING)


class LeanUnetBlock(UnetDecoderBlock):
    """A decoder block of U-Net that converts the skip connection to the type and format of the decoded features.

    In autocast, the skip connections of a mit encoder are float32 and channels first, also the one at half of the
    resolution, which has no channels. In smp, the concatenation therefore converts the decoded features to float32 and
    channels first, and the next convolution converts the result back.
    """

    def forward(
        self, feature_map: Tensor, target_height: int, target_width: int, skip_connection: Tensor | None = None
    ) -> Tensor:
        """Return the decoded features (B, C, H, W) from the coarser ones, as smp does."""
        decoded = F.interpolate(feature_map, (target_height, target_width), mode=self.interpolation_mode)
        if skip_connection is not None:
            skip = skip_connection.to(decoded.dtype, memory_format=torch.channels_last)
            decoded = self.attention1(torch.cat([decoded, skip], dim=1) if skip.shape[1] else decoded)
        return self.attention2(self.conv2(self.conv1(decoded)))


class FusedSegformerDecoder(SegformerDecoder):
    """The decoder of Segformer, which convolves before it upsamples.

    The 1 x 1 convolution of the four concatenated features is the sum of one convolution of each, and a convolution of
    1 x 1 and a bilinear interpolation commute. Three of the four features have a quarter of the pixels or fewer.
    """

    def forward(self, features: list[Tensor]) -> Tensor:
        """Return the decoded features (B, C, H / 4, W / 4) from those of the encoder, as smp does."""
        size = [length // 4 for length in features[0].shape[2:]]
        convolution, normalization, activation = self.fuse_stage
        weights = convolution.weight.chunk(len(self.mlp_stage), dim=1)
        stages = zip(self.mlp_stage, reversed(features[-len(weights) :]), weights, strict=True)
        fused = [F.conv2d(mlp(feature), weight) for mlp, feature, weight in stages]
        return activation(normalization(sum(F.interpolate(part, size, mode="bilinear") for part in fused)))


FASTER: dict[type, type] = {SegformerDecoder: FusedSegformerDecoder, UnetDecoderBlock: LeanUnetBlock}


def replace_slow_modules(network: torch.nn.Module) -> None:
    """Replace the modules of a network in place by those in `FASTER`; its function and its weights stay the same."""
    for module in network.modules():
        module.__class__ = FASTER.get(type(module), type(module))


def create_smp_network(architecture: str, model: Model, in_channels: int) -> Any:
    """Create a network of smp; see `learning.networks.create.create_network`."""
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
        raise InputError(
            f"the {model.encoder_weights} weights of {model.encoder_name} cannot be loaded "
            f"({type(error).__name__}: {error}); connect to the internet once, or train from scratch with "
            "model.encoder_weights=null"
        ) from error


def load_smp_network(directory: Path) -> Any:
    """Load a network of smp that ends in logits; see `learning.networks.create.load_network`.

    The encoder is created without pretrained weights, which smp would otherwise download before it loads those of the
    directory.

    Raises:
        InputError: it has an activation, or an encoder that is neither of smp nor a plain one of timm, which might be
            loaded from elsewhere.
    """
    config = read_mapping(directory / "config.json", "export it again")
    if errors := encoder_errors(Model("unet", encoder_name=str(config.get("encoder_name")))):
        raise InputError(f"{errors[0]}")
    network = smp.from_pretrained(directory, strict=True, encoder_weights=None)
    activations = [module for module in network.modules() if isinstance(module, Activation)]
    if any(not isinstance(module.activation, torch.nn.Identity) for module in activations):
        raise InputError("the network must end in logits, without an activation")
    return network


def encoder_errors(model: Model) -> list[ConfigError]:
    """Return the config errors in the encoder and the encoder weights of a network of smp."""
    name, weights = model.encoder_name, model.encoder_weights
    if name is None:
        expected = f"architecture {model.kind} needs an encoder, such as mit_b0"
        return [ConfigError("model.encoder_name", None, expected)]
    if name.startswith("tu-") and not timm.is_model(name.removeprefix("tu-")):
        return [ConfigError("model.encoder_name", name, "must be tu- and a model of timm, such as tu-resnet18")]
    if name not in encoders and not name.startswith("tu-"):
        close = ", ".join(sorted(known for known in encoders if known[:3] == name[:3])[:8]) or "mit_b0"
        return [ConfigError("model.encoder_name", name, f"must be an encoder of smp, such as {close}")]
    pretrained = sorted(encoders.get(name, {}).get("pretrained_settings", {}))
    if weights is not None and name in encoders and weights not in pretrained:
        return [ConfigError("model.encoder_weights", weights, f"must be null or one of {', '.join(pretrained)}")]
    return []
