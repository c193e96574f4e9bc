"""A small convolutional LSTM: a learned baseline whose input is a sequence of images instead of one.

Shi et al., "Convolutional LSTM Network", NeurIPS 2015, followed by a decoder as in SOGMP (Xie and Dames, "Stochastic
Occupancy Grid Map Prediction in Dynamic Scenes", CoRL 2023) without its variational autoencoder.
"""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

from repro.learning.networks.blocks import check_series, conv_block, each_part
from repro.system.errors import InputError


class ConvLSTM(nn.Module, PyTorchModelHubMixin):
    """A ConvLSTM over a sequence of images, with its state at a quarter of the resolution and a decoder to the map.

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.
        hidden: channels of the LSTM state, a multiple of 16.

    Raises:
        InputError: a parameter is not allowed.
    """

    def __init__(self, in_channels: int, frames: int, hidden: int = 32) -> None:
        check_series(in_channels, frames)
        if type(hidden) is not int or hidden < 16 or hidden % 16:
            raise InputError(f"hidden must be a multiple of 16, got {hidden!r}")
        super().__init__()
        self.frames = frames
        self.encoder = nn.Sequential(
            *conv_block(in_channels // frames, hidden // 2, stride=2), *conv_block(hidden // 2, hidden, stride=2)
        )
        self.from_image = nn.Conv2d(hidden, 4 * hidden, 3, padding=1)
        self.from_memory = nn.Conv2d(hidden, 4 * hidden, 3, padding=1, bias=False)
        self.decoder = nn.Sequential(
            *conv_block(hidden, hidden),
            *(nn.Upsample(scale_factor=2, mode="bilinear"), *conv_block(hidden, hidden // 2)),
            *(nn.Upsample(scale_factor=2, mode="bilinear"), *conv_block(hidden // 2, hidden // 2)),
            nn.Conv2d(hidden // 2, 1, 3, padding=1),
        )

    def forward(self, images: Tensor) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W)."""
        encoded = each_part(lambda part: self.from_image(self.encoder(part)), images, self.frames)
        memory = torch.zeros_like(encoded[:, 0].chunk(4, dim=1)[0])
        shown = memory
        for gates in encoded.unbind(1):
            write, keep, show, new = (gates + self.from_memory(shown)).chunk(4, dim=1)
            memory = (keep + 1).sigmoid() * memory + write.sigmoid() * new.tanh()  # + 1: remember at first
            shown = show.sigmoid() * memory.tanh()
        return self.decoder(shown)
