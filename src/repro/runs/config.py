"""Everything that decides the result of a run; it is stored as config.yaml in the run directory."""

import dataclasses
from dataclasses import dataclass
from typing import Any

from repro.config import Encoding, Model, PairCounts, Training
from repro.runs.keys import RunKey


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

    def of_baseline(self, name: str) -> "RunConfig":
        """Return the configuration of a baseline on the same worlds and grid."""
        return RunConfig(self.experiment, None, Model(name), None, self.data)


def differences(existing: RunConfig | Data, requested: RunConfig | Data, ignored: frozenset[str] = frozenset()) -> str:
    """Describe the differences of two configurations, `key is ..., requested ...`; empty without any."""
    first, second = (_flatten(dataclasses.asdict(one)) for one in (existing, requested))
    keys = [key for key in first | second if first.get(key) != second.get(key) and key not in ignored]
    return "; ".join(f"{key} is {first.get(key)}, requested {second.get(key)}" for key in keys)


def _flatten(content: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in content.items():
        flat |= _flatten(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat
