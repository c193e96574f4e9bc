"""Typed parts of the configuration that decide a result.

The values themselves are in conf/, Hydra composes them, `cli.call` checks them.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from repro.fields import KNOWN_KEYS, Epochs, Even, Name, Share, SmallPositive


@dataclass(frozen=True)
class Encoding:
    """How scans become the input of a network: a name and the parameters of `maps.encodings.create_encoding`."""

    __pydantic_config__ = KNOWN_KEYS

    name: Name
    parameters: dict[str, Any]

    @property
    def label(self) -> str:
        """Name of the encoding in paths and tables: its name, with `-no-decay` in the ablation."""
        return self.name if self.decay else f"{self.name}{NO_DECAY}"

    @property
    def decay(self) -> bool:
        """Whether the gray of a hit depends on its age."""
        return self.parameters.get("decay", True)

    @property
    def most_channels(self) -> int:
        """Number of images of the encoding, or more, without creating it."""
        return MOST_CHANNELS * self.frames

    @property
    def frames(self) -> int:
        """Number of parts of the window that have images of their own."""
        return self.parameters.get("frames", 1)


NO_DECAY = "-no-decay"
MOST_CHANNELS = 2  # of an encoding in each part of the window
RECURRENT = ("convgru", "convlstm")  # architectures that need a series of images
PROJECTION = "projection"  # the paper's input
PROJECTION_NO_DECAY = PROJECTION + NO_DECAY  # the input of its ablation


@dataclass(frozen=True)
class PairCounts:
    """Number of pairs in each split; a world and its twin are two."""

    __pydantic_config__ = KNOWN_KEYS

    train: Even
    val: Even
    test: Even


@dataclass(frozen=True)
class Scale:
    """Resolution, amount of data and training schedule; see conf/scale.

    Args:
        takes: how long the study takes, in words.
    """

    __pydantic_config__ = KNOWN_KEYS

    name: Name
    takes: str
    size_px: Annotated[int, Field(ge=32, le=4096, multiple_of=32)]  # the encoder halves its images five times
    pairs: PairCounts
    learning_rate: SmallPositive
    batch_size: Annotated[int, Field(ge=2)]
    max_epochs: Epochs
    flip_augmentation: bool
    ema_decay: Share | None


@dataclass(frozen=True)
class Training:
    """Training settings of a network; see conf/train."""

    __pydantic_config__ = KNOWN_KEYS

    learning_rate: SmallPositive
    min_delta: Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False)]
    patience: Annotated[int, Field(ge=0)]
    batch_size: Annotated[int, Field(ge=2)]  # batch normalization needs two
    max_epochs: Epochs
    dice_eps: SmallPositive
    flip_augmentation: bool = False
    ema_decay: Share | None = None
    loss: Literal["map", "shown"] = "map"
    weights: str | None = None  # of a network of the same form, from which the training starts
