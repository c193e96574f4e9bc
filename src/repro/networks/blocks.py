"""Blocks of the recurrent networks."""

from collections.abc import Callable

from torch import Tensor, nn


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


def check_series(in_channels: int, frames: int) -> None:
    """Check that images are those of a series.

    Raises:
        ValueError: there are fewer than two parts, or another number of images in each.
    """
    if frames < 2 or in_channels % frames:
        raise ValueError(f"needs a series of at least 2 parts, got {in_channels} images in {frames} parts")
