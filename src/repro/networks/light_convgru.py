"""A recurrent network for series of images: a light convolutional GRU over the parts of the window, and a decoder.

Its input, hits and pixels observed to be free, is that of DeepTracking (Ondruska and Posner, AAAI 2016).
"""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn
from torch.nn import functional as F

from repro.networks.blocks import Residual, check_series, conv_block, each_part, last_state

FIRST = 16  # channels of the first layer
DETAIL = 32  # channels of the decoder


class LightConvGRU(nn.Module, PyTorchModelHubMixin):
    """A convolutional GRU at a quarter of the resolution, and a decoder at half the resolution.

    The GRU is convolutional (Ballas et al., "Delving Deeper into Convolutional Networks for Learning Video
    Representations", ICLR 2016) and has no reset gate (Ravanelli et al., "Light Gated Recurrent Units for Speech
    Recognition", 2018). Its update gate has a convolution of 1 x 1. The decoder also sees the series as a whole. It
    predicts the four pixels of each of its cells (Shi et al., "Real-Time Single Image and Video Super-Resolution Using
    an Efficient Sub-Pixel Convolutional Neural Network", CVPR 2016). It is faster than `convgru.ConvGRU`, and less
    accurate on walls that are one pixel wide and with fields of view much wider than in training.

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
            *conv_block(FIRST, hidden, stride=2, batch_norm=True),
        )
        self.from_part = nn.Conv2d(hidden, 2 * hidden, 1)
        self.update = nn.Conv2d(hidden, hidden, 1, bias=False)
        self.candidate = nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2, bias=False)
        self.context = nn.Sequential(*(Residual(hidden, dilation, batch_norm=True) for dilation in (2, 4, 1)))
        self.detail = nn.Conv2d(in_channels, DETAIL, 4, stride=2, padding=1)
        self.decode = nn.Sequential(
            *conv_block(hidden + DETAIL, DETAIL, batch_norm=True), nn.Conv2d(DETAIL, 4, 3, padding=1)
        )
        assert self.from_part.bias is not None
        nn.init.constant_(self.from_part.bias[:hidden], -1)  # the state changes slowly at first

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        detail = self.detail(images).relu()  # (B, DETAIL, H / 2, W / 2)
        encoded = each_part(lambda part: self.from_part(self.encoder(part)), images, self.frames)
        state = self.context(last_state(encoded, self.update, self.candidate))
        state = F.interpolate(state, size=detail.shape[-2:], mode="bilinear")
        return F.pixel_shuffle(self.decode(torch.cat([state, detail], dim=1)), 2)
