"""The architectures of segmentation-models-pytorch (smp); imported only where one is used, which takes seconds."""

from functools import reduce
from pathlib import Path
from typing import Any

import segmentation_models_pytorch as smp
import timm
import torch
from segmentation_models_pytorch.base.modules import Activation
from segmentation_models_pytorch.decoders.fpn.decoder import FPNDecoder
from segmentation_models_pytorch.decoders.segformer.decoder import SegformerDecoder
from segmentation_models_pytorch.decoders.unet.decoder import UnetDecoderBlock
from segmentation_models_pytorch.encoders import encoders
from torch import Tensor
from torch.nn import functional as F

from repro.fields import ConfigError
from repro.networks.model import Model
from repro.system.errors import InputError

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


class FusedFPNDecoder(FPNDecoder):
    """The decoder of FPN, which convolves before it upsamples, and adds before it upsamples.

    The finest level of the pyramid is the sum of the coarser one, upsampled to twice the size, and a 1 x 1 convolution
    of the finest features of the encoder. A 3 x 3 convolution after nearest-neighbor upsampling is a transposed
    convolution of 4 x 4 with stride 2, whose weights are sums of its own, and the two convolutions of the features are
    one of 3 x 3 with few channels. The sum is never computed, and the operations of the largest convolution of FPN fall
    by 43 %. The segmentation blocks of the coarser levels end in the same bilinear upsampling, which is computed once.
    """

    def forward(self, features: list[Tensor]) -> Tensor:
        """Return the decoded features (B, C, H / 4, W / 4) from those of the encoder, as smp does."""
        if self.p2.interpolation_mode != "nearest" or self.merge.policy != "add":
            return super().forward(features)
        c2, c3, c4, c5 = features[-4:]
        p5 = self.p5(c5)
        p4 = self.p4(p5, c4)
        p3 = self.p3(p4, c3)
        *coarse_blocks, fine_block = (each.block for each in self.seg_blocks)
        convolution, normalization, activation = fine_block[0].block
        fine = activation(normalization(_convolve_sum(p3, c2, self.p2.skip_conv, convolution.weight)))
        levels = zip(coarse_blocks, (p5, p4, p3), strict=True)
        coarse = reduce(torch.add, [block[-1].block(block[:-1](level)) for block, level in levels])
        return self.dropout(F.interpolate(coarse, scale_factor=2.0, mode="bilinear", align_corners=True) + fine)


def _convolve_sum(coarse: Tensor, skip: Tensor, skip_conv: torch.nn.Conv2d, weight: Tensor) -> Tensor:
    """Convolve the sum of an upsampled and a convolved feature map with zero padding, without computing the sum.

    Args:
        coarse: coarse features (B, C, H, W), of which each pixel stands for 2 x 2 pixels of the sum.
        skip: features (B, S, 2 H, 2 W).
        skip_conv: 1 x 1 convolution of `skip` to C channels, whose bias is added to `coarse` instead.
        weight: weights (D, C, 3, 3) of the convolution of the sum.

    Returns:
        The convolved sum, (B, D, 2 H, 2 W).
    """
    assert skip_conv.bias is not None
    summed = _summed(_summed(weight, 2), 3).transpose(0, 1)
    joined = torch.einsum("dcrs,ck->dkrs", weight, skip_conv.weight[:, :, 0, 0])
    coarse = coarse + skip_conv.bias[:, None, None].to(coarse.dtype)
    return F.conv_transpose2d(coarse, summed, stride=2, padding=1) + F.conv2d(skip, joined, padding=1)


def _summed(weight: Tensor, dim: int) -> Tensor:
    """Sum the three weights along a side of a kernel into the four that act on the pixels before their doubling."""
    first, middle, last = weight.unbind(dim)
    return torch.stack([last, middle + last, first + middle, first], dim)


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
        return activation(normalization(sum(F.interpolate(each, size, mode="bilinear") for each in fused)))


FASTER: dict[type, type] = {
    FPNDecoder: FusedFPNDecoder,
    SegformerDecoder: FusedSegformerDecoder,
    UnetDecoderBlock: LeanUnetBlock,
}


def replace_slow_modules(network: torch.nn.Module) -> None:
    """Replace the modules of a network in place by those in `FASTER`; its function and its weights stay the same."""
    for module in network.modules():
        module.__class__ = FASTER.get(type(module), type(module))


def create_smp_network(architecture: str, model: Model, in_channels: int) -> Any:
    """Create a network of smp; see `networks.create.create_network`."""
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
    """Load a network of smp that ends in logits; see `networks.create.load_network`.

    The encoder is created without pretrained weights, which smp would otherwise download before it loads those of the
    directory.

    Raises:
        ValueError: it has an activation.
    """
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
