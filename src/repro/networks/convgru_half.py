"""A recurrent network for series of images that is faster than `convgru`: no layer is at full resolution."""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn
from torch.nn import functional as F

from repro.networks.blocks import SeriesGRU, check_series, conv_block, resized

FIRST = 16  # channels of the first layer
DETAIL = 32  # channels of the decoder


class ConvGRUHalf(SeriesGRU, PyTorchModelHubMixin):
    """The GRU of `convgru.ConvGRU`, whose decoder predicts four pixels in each cell of half the resolution.

    The first layer has no normalization. Pixels are ordered as in the sub-pixel convolution of Shi et al., "Real-Time
    Single Image and Video Super-Resolution Using an Efficient Sub-Pixel Convolutional Neural Network", CVPR 2016.

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.
        hidden: channels of the state, at a quarter of the resolution, a multiple of 16.

    Raises:
        ValueError: a parameter is not allowed.
    """

    def __init__(self, in_channels: int, frames: int, hidden: int = 48) -> None:
        check_series(in_channels, frames)
        if hidden < 16 or hidden % 16:
            raise ValueError(f"hidden must be a multiple of 16, got {hidden}")
        encoder = nn.Sequential(
            nn.Conv2d(in_channels // frames, FIRST, 3, stride=2, padding=1),
            nn.ReLU(inplace=True),
            *conv_block(FIRST, hidden, stride=2),
        )
        super().__init__(encoder, frames, hidden)
        self.detail = nn.Conv2d(in_channels, DETAIL, 4, stride=2, padding=1)
        self.decode = nn.Sequential(*conv_block(hidden + DETAIL, DETAIL), nn.Conv2d(DETAIL, 4, 3, padding=1))

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        state = self.summary(images)
        detail = self.detail(images).relu()  # (B, DETAIL, H / 2, W / 2)
        cells = self.decode(torch.cat([resized(state, detail), detail], dim=1))  # (B, 4, H / 2, W / 2)
        return F.pixel_shuffle(cells, 2)
