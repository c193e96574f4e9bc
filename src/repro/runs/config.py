"""Everything that decides the result of a run; it is stored as config.yaml in the run directory.

The values themselves are in conf/, Hydra composes them, `cli.call` checks them.
"""

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from repro.runs.keys import RunKey
from repro.runs.model import Model
from repro.system.fields import KNOWN_KEYS, Epochs, Even, Name, Share, SmallPositive

NO_DECAY = "-no-decay"
MOST_CHANNELS = 2  # of an encoding in each part of the window
RECURRENT = ("convgru", "convlstm")  # architectures that need a series of images
PROJECTION = "projection"  # the paper's input
PROJECTION_NO_DECAY = PROJECTION + NO_DECAY  # the input of its ablation
IN_KEY = ("model.name", "encoding.name", "encoding.parameters.decay")  # settings that the key of a run names


@dataclass(frozen=True)
class EncodingChoice:
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
    loss: Literal["map", "cross_entropy", "shown"] = "map"
    weights: str | None = None  # of a network of the same form, from which the training starts


@dataclass(frozen=True)
class Data:
    """The data of a run: name of the scale, grid size [px, m], pairs, and fingerprint of the worlds."""

    scale: str
    size_px: int
    size_m: float
    pairs: PairCounts
    worlds: str


@dataclass(frozen=True)
class RunConfig:
    """Everything that determines the result of a run. A baseline has no seed, encoding or training settings."""

    experiment: str
    seed: int | None
    model: Model
    encoding: EncodingChoice | None
    data: Data
    train: Training | None = None

    @property
    def key(self) -> RunKey:
        """The identity of the run."""
        return RunKey(self.experiment, self.model.name, self.encoding.label if self.encoding else "", self.seed)

    @property
    def settings(self) -> dict[str, Any]:
        """All settings that the key does not name, by their keys on the command line; empty for a baseline."""
        if not self.encoding or not self.train:
            return {}
        content = dataclasses.asdict(self)
        flat = flatten({name: content[name] for name in ("model", "encoding", "train")})
        return {key: value for key, value in flat.items() if key not in IN_KEY}

    def of_baseline(self, name: str) -> "RunConfig":
        """Return the configuration of a baseline on the same worlds and grid."""
        return RunConfig(self.experiment, None, Model(name), None, self.data)


def differences(existing: RunConfig | Data, requested: RunConfig | Data) -> str:
    """Describe the differences of two configurations, `key is ..., requested ...`; empty without any."""
    first, second = (flatten(dataclasses.asdict(one)) for one in (existing, requested))
    keys = [key for key in first | second if first.get(key) != second.get(key)]
    return "; ".join(
        f"{key}: the file of conf/world is another or has changed since"
        if key.endswith("worlds")
        else f"{key} is {first.get(key)}, requested {second.get(key)}"
        for key in keys
    )


def flatten(content: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a nested mapping as one level, its keys joined by dots after a prefix."""
    flat: dict[str, Any] = {}
    for key, value in content.items():
        flat |= flatten(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat
