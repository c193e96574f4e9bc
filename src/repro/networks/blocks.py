"""Blocks of the recurrent networks."""

from torch import nn


def conv_block(channels: int, new_channels: int, stride: int = 1, dilation: int = 1) -> tuple[nn.Module, ...]:
    """Return a convolution of 3 x 3, group normalization in eight groups, and a rectifier."""
    return (
        nn.Conv2d(channels, new_channels, 3, stride=stride, padding=dilation, dilation=dilation),
        nn.GroupNorm(8, new_channels),
        nn.ReLU(inplace=True),
    )
