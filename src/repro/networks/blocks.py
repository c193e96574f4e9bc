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


class Residual(nn.Module):
    """Two convolutions, the first dilated, added to their input."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        self.block = nn.Sequential(*conv_block(channels, channels, dilation=dilation), nn.Conv2d(channels, channels, 1))

    def forward(self, images: Tensor) -> Tensor:
        """Return images of the same shape, (B, C, H, W)."""
        return images + self.block(images)


class SeriesGRU(nn.Module):
    """A convolutional GRU over the parts of a window, and residual blocks on its last state.

    The GRU is convolutional (Ballas et al., "Delving Deeper into Convolutional Networks for Learning Video
    Representations", ICLR 2016) and has no reset gate (Ravanelli et al., "Light Gated Recurrent Units for Speech
    Recognition", 2018).

    Args:
        encoder: maps the images of a part, (B, kinds, H, W), to features, (B, hidden, h, w).
        frames: parts of the window, K.
        hidden: channels of the state.
    """

    def __init__(self, encoder: nn.Module, frames: int, hidden: int) -> None:
        super().__init__()
        self.frames = frames
        self.encoder = encoder
        self.from_part = nn.Conv2d(hidden, 2 * hidden, 1)
        self.gate = nn.Conv2d(hidden, hidden, 3, padding=1, bias=False)
        self.candidate = nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2, bias=False)
        self.context = nn.Sequential(Residual(hidden, 2), Residual(hidden, 4), Residual(hidden, 1))
        assert self.from_part.bias is not None
        nn.init.constant_(self.from_part.bias[:hidden], -1)  # the state changes slowly at first

    def summary(self, images: Tensor) -> Tensor:
        """Return the last state of a window, (B, C, H, W), after the residual blocks, (B, hidden, h, w)."""
        encoded = each_part(lambda part: self.from_part(self.encoder(part)), images, self.frames)
        updates, candidates = encoded.chunk(2, dim=2)
        state = updates[:, 0].sigmoid() * candidates[:, 0].tanh()  # the state before the first part is zero
        for part in range(1, self.frames):
            new = (candidates[:, part] + self.candidate(state)).tanh()
            state = state + (updates[:, part] + self.gate(state)).sigmoid() * (new - state)
        return self.context(state)


def check_series(in_channels: int, frames: int) -> None:
    """Check that images are those of a series.

    Raises:
        ValueError: there are fewer than two parts, or another number of images in each.
    """
    if frames < 2 or in_channels % frames:
        raise ValueError(f"needs a series of at least 2 parts, got {in_channels} images in {frames} parts")


def resized(images: Tensor, like: Tensor) -> Tensor:
    """Interpolate images to the size of others."""
    return F.interpolate(images, size=like.shape[-2:], mode="bilinear")
