"""The trainings of a study and the estimated duration of the remaining ones."""

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import mean
from typing import Any

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.networks.model import NETWORKS
from repro.reporting.names import duration, predictor_title
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.system.errors import InputError
from repro.world_config import is_moving


@dataclass(frozen=True)
class Study:
    """The trainings of one seed: the paper's networks in every experiment, and the ablation with moving obstacles.

    Args:
        outputs: the outputs directory.
        experiments: `world.experiments` of the configuration.
        seed: seed of the trainings.
    """

    outputs: Outputs
    experiments: Mapping[str, Mapping[str, Any]]
    seed: int

    def runs(self) -> dict[RunKey, Run]:
        """Return the run of each training; its directory may be missing. The paper's world has 24 trainings."""
        moving = [name for name, experiment in self.experiments.items() if is_moving(experiment)]
        keys = [
            RunKey(experiment, model, encoding, self.seed)
            for encoding, experiments in ((PROJECTION, self.experiments), (PROJECTION_NO_DECAY, moving))
            for experiment in experiments
            for model in NETWORKS
        ]
        return {key: self.outputs.run(key) for key in keys}

    def progress(self, key: RunKey) -> str | None:
        """Describe a training, the finished trainings of the study and the remaining time; None if not of the study."""
        runs = self.runs()
        if key not in runs:
            return None
        trained = sum(_is_trained(run) for run in runs.values())
        title = f"training exp {key.experiment}, {predictor_title(key.model, key.encoding)}"
        left = self.seconds_left()
        estimate = f", the rest takes about {duration(left)} one after the other" if left else ""
        return f"{title} ({trained} of the {len(runs)} trainings of the study are finished{estimate})"

    def seconds_left(self) -> float | None:
        """Estimate the duration of the remaining trainings by network [s]; None before the first one is finished."""
        runs = self.runs()
        durations: dict[str, list[float]] = {}
        for key, run in runs.items():
            if _is_trained(run):
                durations.setdefault(key.model, []).append(run.provenance().fact("training_seconds") or 0.0)
        if not durations:
            return None
        usual = mean(mean(seconds) for seconds in durations.values())
        left = [key.model for key, run in runs.items() if not _is_trained(run)]
        return sum(mean(durations[model]) if model in durations else usual for model in left)


def _is_trained(run: Run) -> bool:
    try:
        return run.is_trained
    except InputError:
        return False
