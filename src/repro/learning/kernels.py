"""Faster kernels for training: the same functions and names of weights, with other rounding.

All devices use the channels-last memory format. Segformer's decoder convolves before it upsamples, which halves the
time of a training step. U-Net's decoder concatenates without converting the decoded features, which saves a seventh of
a step at 256 px in bfloat16. On a CPU, two operations of the paper's networks use slow PyTorch kernels (2.15), 4 to 13
times slower in bfloat16 than necessary: the gradient of a depthwise convolution on a map smaller than 3 x 3 pixels (the
last stage of mit_b0 at 64 px; a tenth of a training step of U-Net, FPN and Segformer), and group normalization in the
channels-last format (decoder of FPN; a twentieth).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from repro.learning.networks.create import replace_slow_modules


class DepthwiseConv2d(nn.Conv2d):
    """A depthwise convolution that pads maps smaller than its kernel with zeros, which equals its own zero padding."""

    def forward(self, images: Tensor) -> Tensor:
        """Return the convolved images, (B, C, H, W)."""
        height, width = images.shape[-2:]
        below, right = (max(0, kernel - size) for kernel, size in zip(self.kernel_size, (height, width), strict=True))
        if not (below or right):
            return super().forward(images)
        return super().forward(F.pad(images, (0, right, 0, below)))[..., :height, :width]


class FloatGroupNorm(nn.GroupNorm):
    """Group normalization in float32, the type of its weights, as in CUDA's autocast."""

    def forward(self, images: Tensor) -> Tensor:
        """Return the normalized images, (B, C, H, W), in the type of the input."""
        return super().forward(images.to(self.weight.dtype)).to(images.dtype)


def create_optimizer(network: nn.Module, learning_rate: float) -> torch.optim.Optimizer:
    """Create Adam (paper: "Prediction Models") for a network, with one kernel for all weights."""
    return torch.optim.Adam(network.parameters(), lr=learning_rate, fused=True)


def accelerate(network: nn.Module, device: str) -> None:
    """Replace slow modules of a network in place; its function and the names of its weights stay the same.

    Args:
        network: any network.
        device: cpu or cuda.
    """
    network.to(memory_format=torch.channels_last)
    replace_slow_modules(network)
    for module in network.modules() if device == "cpu" else ():
        if type(module) is nn.Conv2d and _is_depthwise(module):
            module.__class__ = DepthwiseConv2d
        elif type(module) is nn.GroupNorm and module.affine:
            module.__class__ = FloatGroupNorm


def _is_depthwise(conv: nn.Conv2d) -> bool:
    """Return whether a convolution is depthwise, 3 x 3, with stride 1 and an output as large as its input."""
    shape = (conv.kernel_size, conv.stride, conv.padding, conv.dilation, conv.padding_mode)
    return 1 < conv.groups == conv.in_channels and shape == ((3, 3), (1, 1), (1, 1), (1, 1), "zeros")
