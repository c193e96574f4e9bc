"""A recurrent network for series of images: a convolutional GRU over the parts of the window, and a decoder.

Its input, hits and pixels observed to be free, is that of DeepTracking (Ondruska and Posner, AAAI 2016).
"""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

from repro.networks.blocks import SeriesGRU, check_series, conv_block, resized

DETAIL = 16  # channels at full resolution


class ConvGRU(SeriesGRU, PyTorchModelHubMixin):
    """A convolutional GRU at a fraction of the resolution, a decoder, and skip connections from the series as a whole.

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.
        hidden: channels of the state, a multiple of 16.
        stride: pixels per cell of the state along one side, 2 or 4.

    Raises:
        ValueError: a parameter is not allowed.
    """

    def __init__(self, in_channels: int, frames: int, hidden: int = 48, stride: int = 4) -> None:
        check_series(in_channels, frames)
        if hidden < 16 or hidden % 16 or stride not in (2, 4):
            raise ValueError(f"hidden must be a multiple of 16 and stride 2 or 4, got {hidden} and {stride}")
        encoder = nn.Sequential(
            *conv_block(in_channels // frames, hidden // 2, stride=2),
            *conv_block(hidden // 2, hidden, stride=stride // 2),
        )
        super().__init__(encoder, frames, hidden)
        self.detail = nn.Conv2d(in_channels, DETAIL, 3, padding=1)
        self.half_detail = nn.Conv2d(DETAIL, hidden // 2, 3, stride=2, padding=1)
        self.decode_half = nn.Sequential(*conv_block(hidden + hidden // 2, hidden // 2))
        self.decode_full = nn.Sequential(nn.Conv2d(hidden // 2 + DETAIL, DETAIL, 3, padding=1), nn.ReLU(inplace=True))
        self.to_map = nn.Conv2d(DETAIL, 1, 3, padding=1)

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        state = self.summary(images)
        detail = self.detail(images).relu()
        half_detail = self.half_detail(detail).relu()
        half = self.decode_half(torch.cat([resized(state, half_detail), half_detail], dim=1))
        return self.to_map(self.decode_full(torch.cat([resized(half, detail), detail], dim=1)))
