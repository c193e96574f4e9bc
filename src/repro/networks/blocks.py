"""Blocks of the recurrent networks."""

from collections.abc import Callable

from torch import Tensor, nn
from torch.nn import functional as F


def conv_block(channels: int, new_channels: int, stride: int = 1, dilation: int = 1) -> tuple[nn.Module, ...]:
    """Return a convolution of 3 x 3, group normalization in eight groups, and a rectifier."""
    return (
        nn.Conv2d(channels, new_channels, 3, stride=stride, padding=dilation, dilation=dilation),
        nn.GroupNorm(8, new_channels),
        nn.ReLU(inplace=True),
    )


def each_part(encode: Callable[[Tensor], Tensor], images: Tensor, frames: int) -> Tensor:
    """Encode the images of each part of a window.

    Args:
        encode: maps the images of a part, (B, kinds, H, W), to features, (B, F, h, w).
        images: images of a window, (B, C, H, W), where each kind of image has one per part, oldest first.
        frames: parts of the window, K.

    Returns:
        features, (B, K, F, h, w), oldest part first.
    """
    parts = images.unflatten(1, (-1, frames)).transpose(1, 2)  # (B, K, kinds, H, W)
    return encode(parts.flatten(0, 1)).unflatten(0, parts.shape[:2])


def light_gru(inputs: Tensor, gate: nn.Module, candidate: nn.Module) -> Tensor:
    """Run a GRU without reset gate over a sequence and return its last state.

    Ravanelli et al., "Light Gated Recurrent Units for Speech Recognition", 2018, with tanh in place of the rectifier.

    Args:
        inputs: terms of the inputs in the update gate and in the candidate, one after the other, (B, K, 2 F, h, w),
            the oldest first.
        gate: maps a state (B, F, h, w) to its term in the update gate.
        candidate: maps a state to its term in the candidate.

    Returns:
        states, (B, F, h, w).
    """
    updates, candidates = inputs.chunk(2, dim=2)
    state = updates[:, 0].sigmoid() * candidates[:, 0].tanh()  # the state before the first part is zero
    for part in range(1, inputs.shape[1]):
        new = (candidates[:, part] + candidate(state)).tanh()
        state = state + (updates[:, part] + gate(state)).sigmoid() * (new - state)
    return state


class Residual(nn.Module):
    """Two convolutions, the first dilated, added to their input."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        self.block = nn.Sequential(*conv_block(channels, channels, dilation=dilation), nn.Conv2d(channels, channels, 1))

    def forward(self, images: Tensor) -> Tensor:
        """Return images of the same shape, (B, C, H, W)."""
        return images + self.block(images)


def resized(images: Tensor, like: Tensor) -> Tensor:
    """Interpolate images to the size of others."""
    return F.interpolate(images, size=like.shape[-2:], mode="bilinear")
