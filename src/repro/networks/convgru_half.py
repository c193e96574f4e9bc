"""A recurrent network for series of images that is faster than `convgru`: no layer is at full resolution."""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn
from torch.nn import functional as F

from repro.networks.blocks import Residual, conv_block, each_part, light_gru, resized

FIRST = 16  # channels of the first layer
DETAIL = 32  # channels of the decoder


class ConvGRUHalf(nn.Module, PyTorchModelHubMixin):
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
        super().__init__()
        if frames < 2 or in_channels % frames:
            raise ValueError(f"needs a series of at least 2 parts, got {in_channels} images in {frames} parts")
        if hidden < 16 or hidden % 16:
            raise ValueError(f"hidden must be a multiple of 16, got {hidden}")
        self.frames = frames
        self.encoder = nn.Sequential(
            nn.Conv2d(in_channels // frames, FIRST, 3, stride=2, padding=1),
            nn.ReLU(inplace=True),
            *conv_block(FIRST, hidden, stride=2),
        )
        self.from_part = nn.Conv2d(hidden, 2 * hidden, 1)
        self.gate = nn.Conv2d(hidden, hidden, 3, padding=1, bias=False)
        self.candidate = nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2, bias=False)
        self.context = nn.Sequential(Residual(hidden, 2), Residual(hidden, 4), Residual(hidden, 1))
        self.detail = nn.Conv2d(in_channels, DETAIL, 4, stride=2, padding=1)
        self.decode = nn.Sequential(*conv_block(hidden + DETAIL, DETAIL), nn.Conv2d(DETAIL, 4, 3, padding=1))
        assert self.from_part.bias is not None
        nn.init.constant_(self.from_part.bias[:hidden], -1)  # the state changes slowly at first

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        encoded = each_part(lambda part: self.from_part(self.encoder(part)), images, self.frames)
        state = self.context(light_gru(encoded, self.gate, self.candidate))
        detail = self.detail(images).relu()  # (B, DETAIL, H / 2, W / 2)
        cells = self.decode(torch.cat([resized(state, detail), detail], dim=1))  # (B, 4, H / 2, W / 2)
        return F.pixel_shuffle(cells, 2)
