"""The network of DeepTracking: a recurrent network at full resolution, a baseline for networks with a series of images.

Ondruska and Posner, "Deep Tracking: Seeing Beyond Seeing Using Recurrent Neural Networks", AAAI 2016, with the layers
of version 1.1 of their code. Here it is trained with the true map, as all other networks, or with train=visible as its
authors do, without true maps, see `learning.losses.VisibleLoss`.
"""

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

from repro.networks.blocks import check_series, each_part

SIZE = 7  # of every kernel
ENCODED, STATE = 16, 32  # channels


class DeepTracking(nn.Module, PyTorchModelHubMixin):
    """Three convolutions of 7 x 7, applied to each part of the window and the state before it, 78,449 parameters.

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.

    Raises:
        ValueError: see `blocks.check_series`.
    """

    def __init__(self, in_channels: int, frames: int) -> None:
        check_series(in_channels, frames)
        super().__init__()
        self.frames = frames
        self.encoder = nn.Conv2d(in_channels // frames, ENCODED, SIZE, padding="same")
        self.transition = nn.Conv2d(ENCODED + STATE, STATE, SIZE, padding="same")
        self.to_map = nn.Conv2d(STATE, 1, SIZE, padding="same")

    def forward(self, images: Tensor, *, every_part: bool = False) -> Tensor:
        """Predict a map of logits from the images of a window.

        Args:
            images: images of a window, (B, C, H, W).
            every_part: predict a map after every part of the window.

        Returns:
            logits of the last map, (B, 1, H, W), or of all maps, (B, K, H, W).
        """
        encoded = each_part(self.encoder, images, self.frames).sigmoid()
        states = [encoded.new_zeros(images.shape[0], STATE, *images.shape[-2:])]
        for part in encoded.unbind(1):
            states.append(self.transition(torch.cat([part, states[-1]], dim=1)).sigmoid())
        maps = [self.to_map(state) for state in (states[1:] if every_part else states[-1:])]
        return torch.cat(maps, dim=1)
