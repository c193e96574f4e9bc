"""A network as it trains fastest: the same modules and weights, computed by better kernels.

Channels last on every device. On a CPU two modules of the paper's networks meet kernels of PyTorch (2.15) that take 4
to 13 times as long in bfloat16 as they need: the gradient of a depthwise convolution on a map of less than 3 x 3 pixels
(mit_b0's last stage at 64 px; a tenth of a training step of U-Net, FPN and Segformer) and group normalisation with the
channels last (FPN's decoder; a twentieth). What is computed stays, and so do the names of the weights.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F


class DepthwiseConv2d(nn.Conv2d):
    """A depthwise convolution that widens maps smaller than its kernel by zeros, which it would see there anyway."""

    def forward(self, images: Tensor) -> Tensor:
        """Convolves images (B, C, H, W)."""
        height, width = images.shape[-2:]
        below, right = (max(0, kernel - size) for kernel, size in zip(self.kernel_size, (height, width), strict=True))
        if not (below or right):
            return super().forward(images)
        return super().forward(F.pad(images, (0, right, 0, below)))[..., :height, :width]


class FloatGroupNorm(nn.GroupNorm):
    """Group normalisation in the type of its weights, float32, as CUDA's autocast has it."""

    def forward(self, images: Tensor) -> Tensor:
        """Normalises images (B, C, H, W) of any type."""
        return super().forward(images.to(self.weight.dtype)).to(images.dtype)


def accelerate(network: nn.Module, device: str) -> None:
    """Makes a network train faster on a device, in place; what it computes and its weights' names stay.

    Args:
        network: any network.
        device: cpu or cuda.
    """
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    for module in network.modules() if device == "cpu" else ():
        if type(module) is nn.Conv2d and _is_depthwise(module):
            module.__class__ = DepthwiseConv2d
        elif type(module) is nn.GroupNorm and module.affine:
            module.__class__ = FloatGroupNorm


def _is_depthwise(conv: nn.Conv2d) -> bool:
    """Says whether each channel is convolved by itself with a 3 x 3 kernel, to a map as large as before."""
    shape = (conv.kernel_size, conv.stride, conv.padding, conv.dilation, conv.padding_mode)
    return 1 < conv.groups == conv.in_channels and shape == ((3, 3), (1, 1), (1, 1), (1, 1), "zeros")
