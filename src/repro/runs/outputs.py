"""An outputs directory: the recordings, runs, baselines and reports of one scale.

outputs/<scale>/
    recordings/exp3/                    see `recordings.reader`
    runs/exp3/unet/projection/seed0/    a run directory, see `runs.directories`
    baselines/exp3/tracker/             run directory of a baseline, which has no encoding, seed or weights
    tables/ figures/ analysis/ worlds/ predictions/ exports/
    report.html
"""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from repro.runs.config import RunConfig, differences
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.system.errors import InputError


@dataclass(frozen=True)
class Outputs:
    """An outputs directory: the results of one scale, or of a variant of it.

    Args:
        path: the directory.
        shared: directory of its recordings if outside `path`; several outputs directories may share it.
    """

    path: Path
    shared: Path | None = None

    @property
    def analysis(self) -> Path:
        return self.path / "analysis"

    @property
    def tables(self) -> Path:
        return self.path / "tables"

    @property
    def figures(self) -> Path:
        return self.path / "figures"

    @property
    def worlds(self) -> Path:
        return self.path / "worlds"

    def recordings(self, experiment: str) -> Path:
        return self._recordings / f"exp{experiment}"

    def recorded(self) -> dict[str, Path]:
        """Return the directories of the completely recorded experiments, by name."""
        manifests = sorted(self._recordings.glob("exp*/manifest.json"))
        return {path.parent.name.removeprefix("exp"): path.parent for path in manifests}

    @property
    def _recordings(self) -> Path:
        return self.shared or self.path / "recordings"

    def run(self, key: RunKey) -> Run:
        return Run(self.path / key.path)

    def check_data(self, config: RunConfig) -> None:
        """Check that a run belongs beside the others, see `check_together`.

        Runs that cannot be read are passed over; the tables name them.
        """
        others = {}
        for run in self.runs():
            with contextlib.suppress(InputError):
                others[run] = run.config()
        check_together(config, others)

    def runs(self) -> Iterator[Run]:
        """Yield every run directory, of networks and of baselines."""
        for pattern in ("runs/exp*/*/*/seed*", "baselines/exp*/*"):
            yield from (Run(path) for path in sorted(self.path.glob(pattern)) if path.is_dir())


def check_together(config: RunConfig, others: Mapping[Run, RunConfig]) -> None:
    """Check that a run can share tables with others: same scale, grid and pairs, and per experiment the same worlds.

    Runs that differ in the seed alone must have the same settings, because tables average them.

    Raises:
        InputError: another run has other data, or another seed other settings; the message names the differences.
    """
    for run, other in others.items():
        worlds = config.data.worlds if other.experiment == config.experiment else other.data.worlds
        if listing := differences(other.data, replace(config.data, worlds=worlds)):
            raise InputError(
                f"{run} has other data than {config.key.path} ({listing}): move or delete it, or set outputs="
            )
        is_other_seed = other.seed != config.seed and replace(other.key, seed=config.seed) == config.key
        if is_other_seed and (listing := differences(replace(other, seed=config.seed), config)):
            raise InputError(f"{run}, another seed, has other settings ({listing}): move or delete it, or set outputs=")
