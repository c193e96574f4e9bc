"""Everything that decides the result of a run; it is stored as config.yaml in the run directory."""

import dataclasses
from dataclasses import dataclass
from typing import Any

from repro.config import Encoding, PairCounts, Training
from repro.networks.model import Model
from repro.runs.keys import RunKey

IN_KEY = ("model.name", "encoding.name", "encoding.parameters.decay")  # settings that the key of a run names


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
    encoding: Encoding | None
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
