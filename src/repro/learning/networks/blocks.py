"""Blocks of the recurrent networks."""

from collections.abc import Callable

from torch import Tensor, nn

from repro.system.errors import InputError


def conv_block(channels: int, new_channels: int, stride: int = 1, dilation: int = 1) -> tuple[nn.Module, ...]:
    """Return a convolution of 3 x 3, group normalization in eight groups, and a rectifier."""
    return (
        nn.Conv2d(channels, new_channels, 3, stride=stride, padding=dilation, dilation=dilation),
        nn.GroupNorm(8, new_channels),
        nn.ReLU(inplace=True),
    )


class Residual(nn.Module):
    """Two convolutions, the first dilated, added to their input."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        first = conv_block(channels, channels, dilation=dilation)
        self.block = nn.Sequential(*first, nn.Conv2d(channels, channels, 1))

    def forward(self, images: Tensor) -> Tensor:
        """Return images of the same shape, (B, C, H, W)."""
        return images + self.block(images)


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


def last_state(encoded: Tensor, to_update: nn.Module, to_candidate: nn.Module) -> Tensor:
    """Return the state of a convolutional GRU without a reset gate after the newest part of a window, (B, F, h, w).

    Args:
        encoded: what each part adds to the update gate and to the candidate, (B, K, 2 F, h, w), oldest part first.
        to_update: maps the state to what it adds to the update gate.
        to_candidate: maps the state to what it adds to the candidate.
    """
    oldest, *others = (part.chunk(2, dim=1) for part in encoded.unbind(1))
    state = oldest[0].sigmoid() * oldest[1].tanh()  # the state before the oldest part is zero
    for update, candidate in others:
        new = (candidate + to_candidate(state)).tanh()
        state = state + (update + to_update(state)).sigmoid() * (new - state)
    return state


def check_series(in_channels: int, frames: int) -> None:
    """Check that images are those of a series.

    Raises:
        InputError: there are fewer than two parts, or another number of images in each.
    """
    if frames < 2 or in_channels % frames:
        raise InputError(f"needs a series of at least 2 parts, got {in_channels} images in {frames} parts")
