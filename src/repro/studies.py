"""The paper's study: its 24 trainings, which of them are done, and how long the others will take."""

from dataclasses import dataclass
from statistics import mean

from repro.config import NETWORKS
from repro.names import NAMES
from repro.runs import Outputs, Run

CELLS = [  # the paper's study: experiment, network, with or without decay
    (experiment, model, variant)
    for variant, experiments in (("decay", "1234"), ("no-decay", "34"))
    for experiment in experiments
    for model in NETWORKS
]


@dataclass(frozen=True)
class Study:
    """The 24 trainings of one seed in an outputs directory."""

    outputs: Outputs
    seed: int

    def runs(self) -> dict[tuple[str, str, str], Run]:
        """The run directory of each cell, which may be missing."""
        return {cell: self.outputs.run(*cell, self.seed) for cell in CELLS}

    def place(self, run: Run) -> str | None:
        """Says which of the study's trainings a run is, `training 7 of 24: exp 3, FPN`; None when it is none."""
        cells = {each.path: cell for cell, each in self.runs().items()}
        if run.path not in cells:
            return None
        experiment, model, variant = cells[run.path]
        trained = sum(_is_trained(each) for each in self.runs().values())
        words = f"training {trained + 1} of {len(CELLS)}: exp {experiment}, {NAMES[model]}"
        spent, left = self.seconds_spent(), self.seconds_left()
        return (
            words
            + (", no decay" if variant == "no-decay" else "")
            + (
                f"; {spent / 60:.0f} min of training behind it, about {left / 60:.0f} left, as measured so far"
                if left
                else ""
            )
        )

    def seconds_spent(self) -> float:
        """Adds up what the trainings took that are done."""
        return sum(sum(seconds) for seconds in self._took().values())

    def seconds_left(self) -> float | None:
        """Foretells what is left to train from what was measured, network by network; None before the first."""
        took = self._took()
        if not took:
            return None
        usual = mean(mean(seconds) for seconds in took.values())
        left = [model for (_, model, _), run in self.runs().items() if not _is_trained(run)]
        return sum(mean(took[model]) if model in took else usual for model in left)

    def _took(self) -> dict[str, list[float]]:
        """The seconds of each training that is done, by network."""
        took: dict[str, list[float]] = {}
        for (_, model, _), run in self.runs().items():
            if _is_trained(run):
                took.setdefault(model, []).append(run.provenance().fact("training_seconds") or 0.0)
        return took


def _is_trained(run: Run) -> bool:
    try:
        return run.is_trained
    except ValueError:
        return False
