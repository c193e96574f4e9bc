"""A recurrent network for series of images: a convolutional GRU over the parts of the window, and a decoder."""

from typing import Literal

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn
from torch.nn import functional as F

from repro.fields import Hidden
from repro.networks.blocks import Residual, check_series, conv_block, each_part, last_state
from repro.system.errors import InputError

DETAIL = 16  # channels at full resolution


class ConvGRU(nn.Module, PyTorchModelHubMixin):
    """A convolutional GRU at a fraction of the resolution, a decoder, and skip connections from the series as a whole.

    The GRU is convolutional (Ballas et al., "Delving Deeper into Convolutional Networks for Learning Video
    Representations", ICLR 2016) and has no reset gate (Ravanelli et al., "Light Gated Recurrent Units for Speech
    Recognition", 2018).

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.
        hidden: channels of the state, a multiple of 16.
        stride: pixels per cell of the state along one side, 2 or 4.

    Raises:
        ValueError: a parameter is not allowed.
    """

    def __init__(self, in_channels: int, frames: int, hidden: Hidden = 48, stride: Literal[2, 4] = 4) -> None:
        check_series(in_channels, frames)
        if hidden < 16 or hidden % 16 or stride not in (2, 4):
            raise InputError(f"hidden must be a multiple of 16 and stride 2 or 4, got {hidden} and {stride}")
        super().__init__()
        self.frames = frames
        self.encoder = nn.Sequential(
            *conv_block(in_channels // frames, hidden // 2, stride=2),
            *conv_block(hidden // 2, hidden, stride=stride // 2),
        )
        self.from_part = nn.Conv2d(hidden, 2 * hidden, 1)
        self.gate = nn.Conv2d(hidden, hidden, 3, padding=1, bias=False)
        self.candidate = nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2, bias=False)
        self.context = nn.Sequential(Residual(hidden, 2), Residual(hidden, 4), Residual(hidden, 1))
        assert self.from_part.bias is not None
        nn.init.constant_(self.from_part.bias[:hidden], -1)  # the state changes slowly at first
        self.detail = nn.Conv2d(in_channels, DETAIL, 3, padding=1)
        self.half_detail = nn.Conv2d(DETAIL, hidden // 2, 3, stride=2, padding=1)
        self.decode_half = nn.Sequential(*conv_block(hidden + hidden // 2, hidden // 2))
        self.decode_full = nn.Sequential(nn.Conv2d(hidden // 2 + DETAIL, DETAIL, 3, padding=1), nn.ReLU(inplace=True))
        self.to_map = nn.Conv2d(DETAIL, 1, 3, padding=1)

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        encoded = each_part(lambda part: self.from_part(self.encoder(part)), images, self.frames)
        state = self.context(last_state(encoded, self.gate, self.candidate))
        detail = self.detail(images).relu()
        half_detail = self.half_detail(detail).relu()
        half = self.decode_half(torch.cat([_resized(state, half_detail), half_detail], dim=1))
        return self.to_map(self.decode_full(torch.cat([_resized(half, detail), detail], dim=1)))


def _resized(images: Tensor, like: Tensor) -> Tensor:
    """Interpolate images to the size of others."""
    return F.interpolate(images, size=like.shape[-2:], mode="bilinear")
