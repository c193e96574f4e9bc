"""A recurrent network for series of images: a convolutional GRU over the parts of the window, and a decoder."""

from typing import Literal

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn
from torch.nn import functional as F

from repro.learning.networks.blocks import Residual, check_series, conv_block, each_part, last_state
from repro.system.errors import InputError

DETAIL = 16  # channels at full resolution


class ConvGRU(nn.Module, PyTorchModelHubMixin):
    """A convolutional GRU at a fraction of the resolution, a decoder, and skip connections from the series as a whole.

    The GRU is convolutional (Ballas et al., "Delving Deeper into Convolutional Networks for Learning Video
    Representations", ICLR 2016) and has no reset gate (Ravanelli et al., "Light Gated Recurrent Units for Speech
    Recognition", 2018).

    Args:
        in_channels: images per window, a multiple of `frames`; each kind of image has one per part, oldest first.
        frames: parts of the window, K.
        hidden: channels of the state, a multiple of 16.
        stride: pixels per cell of the state along one side, 2 or 4.
        centered: the network also gets the distance to the middle of the map, where the robot is: in real logs, pixels
            that it sees for the first time are less often obstacles the farther away they are.
        indexed: the network also learns what each part of the window has in common, such as its length.
        turned: after the training, its logits are the mean of those of the map and of the map turned by half.

    Raises:
        InputError: a parameter is not allowed.
    """

    def __init__(
        self,
        in_channels: int,
        frames: int,
        hidden: int = 48,
        stride: Literal[2, 4] = 4,
        centered: bool = False,
        indexed: bool = False,
        turned: bool = False,
    ) -> None:
        check_series(in_channels, frames)
        _check(hidden, stride, centered=centered, indexed=indexed, turned=turned)
        super().__init__()
        self.frames, self.hidden, self.stride = frames, hidden, stride
        self.centered, self.indexed, self.turned = centered, indexed, turned
        self.encoder = nn.Sequential(
            *conv_block(in_channels // frames, hidden // 2, stride=2),
            *conv_block(hidden // 2, hidden, stride=stride // 2),
        )
        self.from_part = nn.Conv2d(hidden, 2 * hidden, 1)
        self.gate = nn.Conv2d(hidden, hidden, 3, padding=1, bias=False)
        self.candidate = nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2, bias=False)
        self.context = nn.Sequential(Residual(hidden, 2), Residual(hidden, 4), Residual(hidden, 1))
        assert self.from_part.bias is not None
        nn.init.constant_(self.from_part.bias[:hidden], -1)  # the state changes slowly at first
        self.detail = nn.Conv2d(in_channels, DETAIL, 3, padding=1)
        self.half_detail = nn.Conv2d(DETAIL, hidden // 2, 3, stride=2, padding=1)
        self.decode_half = nn.Sequential(*conv_block(hidden + hidden // 2, hidden // 2))
        self.decode_full = nn.Sequential(nn.Conv2d(hidden // 2 + DETAIL, DETAIL, 3, padding=1), nn.ReLU(inplace=True))
        self.to_map = nn.Conv2d(DETAIL, 1, 3, padding=1)

        if indexed:
            self.of_part = nn.Parameter(torch.zeros(frames, 2 * hidden, 1, 1))
        if centered:
            self.from_distance, self.detail_from_distance = (nn.Conv2d(3, channels, 1) for channels in (hidden, DETAIL))
            for layer in (self.from_distance, self.detail_from_distance):
                for weights in layer.parameters():
                    nn.init.zeros_(weights)  # the distance has no effect before the training

    def forward(self, images: Tensor, middle: tuple[float, float] | None = None) -> Tensor:
        """Predict a map of logits, (B, 1, H, W), from the images of a window, (B, C, H, W).

        Args:
            images: the images.
            middle: row and column of the robot [px], if the images are a part of a map; None for the middle.
        """
        if self.training or not self.turned:
            return self._logits(images, middle)
        turned = None if middle is None else (images.shape[-2] - middle[0], images.shape[-1] - middle[1])
        return (self._logits(images, middle) + self._logits(images.flip(-2, -1), turned).flip(-2, -1)) / 2

    def _logits(self, images: Tensor, middle: tuple[float, float] | None) -> Tensor:
        encoded = each_part(lambda part: self.from_part(self.encoder(part)), images, self.frames)
        if self.indexed:
            encoded = encoded + self.of_part
        state = last_state(encoded, self.gate, self.candidate)
        detail = self.detail(images).relu()
        half_detail = self.half_detail(detail).relu()
        if self.centered:
            state = state + self.from_distance(_distances(state, self.stride, middle))
        half = self.decode_half(torch.cat([_resized(self.context(state), half_detail), half_detail], dim=1))
        full = self.decode_full[0](torch.cat([_resized(half, detail), detail], dim=1))
        if self.centered:
            full = full + self.detail_from_distance(_distances(full, 1, middle))
        return self.to_map(self.decode_full[1](full))

    def with_distances(self) -> "ConvGRU":
        """Return a network that is also `centered`, `indexed` and `turned`, with the same weights."""
        sizes = self.detail.in_channels, self.frames, self.hidden, self.stride
        new = ConvGRU(*sizes, centered=True, indexed=True, turned=True)
        new.load_state_dict(new.state_dict() | self.state_dict())
        return new


def _check(hidden: int, stride: int, **flags: bool) -> None:
    """Raise an `InputError` if a parameter is not allowed."""
    are_whole = type(hidden) is int and type(stride) is int
    if not are_whole or hidden < 16 or hidden % 16 or stride not in (2, 4):
        raise InputError(f"hidden must be a multiple of 16 and stride 2 or 4, got {hidden!r} and {stride!r}")
    for name, value in flags.items():
        if type(value) is not bool:  # any text would be true
            raise InputError(f"{name} must be true or false, got {value!r}")


def is_centered(network: nn.Module) -> bool:
    """Return whether a network takes the robot to be in the middle of the map."""
    return isinstance(network, ConvGRU) and network.centered


def _distances(images: Tensor, stride: int, middle: tuple[float, float] | None) -> Tensor:
    """Return powers of the logarithm of the distance to the robot [px], (1, 3, H, W), of the size of some images."""
    sizes = images.shape[-2:]
    places = middle or tuple(stride * size / 2 for size in sizes)
    down, right = (
        (torch.arange(size, device=images.device) + 0.5) * stride - place
        for size, place in zip(sizes, places, strict=True)
    )
    distance = torch.log1p((down[:, None].square() + right.square()).sqrt()) - 2.5  # around zero
    return 4 * torch.stack([distance, distance**2, distance**3])[None]


def _resized(images: Tensor, like: Tensor) -> Tensor:
    """Interpolate images to the size of others."""
    return F.interpolate(images, size=like.shape[-2:], mode="bilinear")
