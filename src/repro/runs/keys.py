"""The identity of a run: experiment, model, encoding and seed, with its path and its columns in tidy tables."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePath

from repro.system.errors import InputError

KEY = ["experiment", "model", "encoding", "seed"]  # columns that identify a run
CELL = KEY[:3]  # columns that the runs of all seeds share
SEED = re.compile(r"seed(\d+)")


@dataclass(frozen=True)
class RunKey:
    """The identity of a run.

    Args:
        experiment: name of the experiment.
        model: name of the network or baseline.
        encoding: label of the encoding (`runs.config.EncodingChoice.label`); empty for a baseline.
        seed: seed of the training; None for a baseline.
    """

    experiment: str
    model: str
    encoding: str = ""
    seed: int | None = None

    @property
    def is_baseline(self) -> bool:
        return not self.encoding

    @property
    def path(self) -> Path:
        """Path of the run directory, relative to the outputs directory."""
        if self.is_baseline:
            return Path("baselines", f"exp{self.experiment}", self.model)
        return Path("runs", f"exp{self.experiment}", self.model, self.encoding, f"seed{self.seed}")

    @classmethod
    def parse(cls, path: PurePath | str) -> "RunKey":
        """Return the key of a run directory from its path, relative to the outputs directory.

        Raises:
            InputError: the path is not that of a run directory.
        """
        match PurePath(path).parts:
            case ("baselines", experiment, model) if experiment.startswith("exp"):
                return cls(experiment[3:], model)
            case ("runs", experiment, model, encoding, seed) if experiment.startswith("exp") and SEED.fullmatch(seed):
                return cls(experiment[3:], model, encoding, int(seed[4:]))
        raise InputError(
            f"expected runs/exp<name>/<model>/<encoding>/seed<n> or baselines/exp<name>/<model>, got {path}"
        )


def lowest_seeds(keys: Iterable[RunKey]) -> list[RunKey]:
    """Return the key with the lowest seed of each cell, see `CELL`; baselines have no seed."""
    lowest: dict[tuple[str, str, str], RunKey] = {}
    for key in sorted(keys, key=lambda key: key.seed or 0):
        lowest.setdefault((key.experiment, key.model, key.encoding), key)
    return list(lowest.values())
