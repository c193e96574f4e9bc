"""A recurrent network for series of images: a light convolutional GRU over the parts of the window, and a decoder.

Its input, hits and pixels observed to be free, is that of DeepTracking (Ondruska and Posner, AAAI 2016).
"""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn
from torch.nn import functional as F

from repro.networks.blocks import check_series, each_part

FIRST = 16  # channels of the first layer
DETAIL = 32  # channels of the decoder


class LightConvGRU(nn.Module, PyTorchModelHubMixin):
    """A convolutional GRU at a quarter of the resolution, and a decoder at half the resolution.

    The GRU is convolutional (Ballas et al., "Delving Deeper into Convolutional Networks for Learning Video
    Representations", ICLR 2016), has no reset gate (Ravanelli et al., "Light Gated Recurrent Units for Speech
    Recognition", 2018), and its update gate sees no neighbors. The decoder also sees the series as a whole. It predicts
    the four pixels of each of its cells (Shi et al., "Real-Time Single Image and Video Super-Resolution Using an
    Efficient Sub-Pixel Convolutional Neural Network", CVPR 2016). It is faster than
    `convgru.ConvGRU`, and more accurate where obstacles are larger than a few pixels.

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.
        hidden: channels of the state.

    Raises:
        ValueError: there are fewer than two parts, or another number of images in each.
    """

    def __init__(self, in_channels: int, frames: int, hidden: int = 48) -> None:
        check_series(in_channels, frames)
        super().__init__()
        self.frames = frames
        self.encoder = nn.Sequential(
            nn.Conv2d(in_channels // frames, FIRST, 3, stride=2, padding=1),
            nn.ReLU(inplace=True),
            *_conv_block(FIRST, hidden, stride=2),
        )
        self.from_part = nn.Conv2d(hidden, 2 * hidden, 1)
        self.update = nn.Conv2d(hidden, hidden, 1, bias=False)
        self.candidate = nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2, bias=False)
        self.context = nn.Sequential(_Residual(hidden, 2), _Residual(hidden, 4), _Residual(hidden, 1))
        self.detail = nn.Conv2d(in_channels, DETAIL, 4, stride=2, padding=1)
        self.decode = nn.Sequential(*_conv_block(hidden + DETAIL, DETAIL), nn.Conv2d(DETAIL, 4, 3, padding=1))
        assert self.from_part.bias is not None
        nn.init.constant_(self.from_part.bias[:hidden], -1)  # the state changes slowly at first

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        detail = self.detail(images).relu()  # (B, DETAIL, H / 2, W / 2)
        state = F.interpolate(self.context(self._last_state(images)), size=detail.shape[-2:], mode="bilinear")
        return F.pixel_shuffle(self.decode(torch.cat([state, detail], dim=1)), 2)

    def _last_state(self, images: Tensor) -> Tensor:
        """Return the state after the newest part, (B, hidden, H / 4, W / 4)."""
        encoded = each_part(lambda part: self.from_part(self.encoder(part)), images, self.frames)
        oldest, *others = (part.chunk(2, dim=1) for part in encoded.unbind(1))
        state = oldest[0].sigmoid() * oldest[1].tanh()  # the state before the oldest part is zero
        for update, candidate in others:
            new = (candidate + self.candidate(state)).tanh()
            state = state + (update + self.update(state)).sigmoid() * (new - state)
        return state


def _conv_block(channels: int, new_channels: int, stride: int = 1, dilation: int = 1) -> tuple[nn.Module, ...]:
    """Return a convolution of 3 x 3, batch normalization, and a rectifier."""
    return (
        nn.Conv2d(channels, new_channels, 3, stride=stride, padding=dilation, dilation=dilation, bias=False),
        nn.BatchNorm2d(new_channels),
        nn.ReLU(inplace=True),
    )


class _Residual(nn.Module):
    """Two convolutions, the first dilated, added to their input."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        self.block = nn.Sequential(
            *_conv_block(channels, channels, dilation=dilation), nn.Conv2d(channels, channels, 1)
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return images of the same shape, (B, C, H, W)."""
        return images + self.block(images)
