"""The trainings of a study, and the state of its recordings and runs."""

import dataclasses
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from repro.baselines.titles import rank
from repro.recordings.format import recordings_in
from repro.reporting.names import model_title
from repro.reporting.render import Cells
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY, PairCounts
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.system.files import is_locked
from repro.worlds.spec import Experiment

MISSING = "missing"


@dataclass(frozen=True)
class StudyPlan:
    """The trainings of one seed: the paper's networks in every experiment, and the ablation with moving obstacles.

    Args:
        outputs: the outputs directory.
        experiments: those of the worlds, by name.
        seed: seed of the trainings.
        worlds: fingerprints of their worlds by experiment; a run of others is none of the study.
    """

    outputs: Outputs
    experiments: Mapping[str, Experiment]
    seed: int
    worlds: Mapping[str, str]

    def runs(self) -> dict[RunKey, Run]:
        """Return the run of each training; its directory may be missing. The paper's world has 24 trainings."""
        moving = [name for name, experiment in self.experiments.items() if experiment.behaviors]
        keys = [
            RunKey(experiment, model, encoding, self.seed)
            for encoding, experiments in ((PROJECTION, self.experiments), (PROJECTION_NO_DECAY, moving))
            for experiment in experiments
            for model in NETWORKS
        ]
        return {key: self.outputs.run(key) for key in keys}

    def is_of_another_world(self, run: Run) -> bool:
        """Whether a run has other worlds than its experiment in this study."""
        config = run.config()
        return self.worlds.get(config.experiment, config.data.worlds) != config.data.worlds


def describe_outputs(study: StudyPlan, pairs: PairCounts) -> str:
    """Return the state of all recordings and runs of an outputs directory as Markdown.

    Args:
        study: the trainings that are counted; the table includes all other runs and seeds.
        pairs: planned number of recordings per experiment.
    """
    outputs, planned, wanted = study.outputs, study.runs(), dataclasses.asdict(pairs)
    existing, others = outputs.named_runs()
    states = {key: _state(run, study) for key, run in (planned | existing).items()}
    ordered = sorted(states, key=lambda key: (key.experiment, key.encoding, rank(key.model), str(key.path)))
    counts = {name: recordings_in(outputs.recordings(name), wanted) for name in study.experiments}
    recorded = [(name, f"{count} of {sum(wanted.values())}") for name, count in counts.items()]
    listed = ", ".join(f"{count} {state}" for state, count in Counter(states[key] for key in planned).most_common())
    missing = Counter(key.model for key in planned if states[key] == MISSING)
    begun = [(key.path, states[key]) for key in ordered if states[key] != MISSING]
    lines = [
        f"{outputs.path}\n",
        Cells(("exp.", "recordings"), recorded).to_markdown(),
        Cells(("run", "status"), begun).to_markdown() if begun else "",
        f"Of the study's {len(planned)} trainings with seed {study.seed}: {listed}.",
    ]
    if missing:
        counts_of = (f"{missing[model]} of {model_title(model)}" for model in NETWORKS if missing[model])
        lines.append(f"Missing: {', '.join(counts_of)}.")
    lines += [f"{path} is passed over: its name is not that of a run." for path in others]
    return "\n".join(lines)


def _state(run: Run, study: StudyPlan) -> str:
    """Return the status of a run in a few words."""
    if not run.has_begun and not run.model.exists():
        return MISSING
    try:
        if study.is_of_another_world(run):
            return "of another world"
        is_stopped = run.status is Status.training and not is_locked(run.path)
        return "stopped" if is_stopped else str(run.status)
    except ValueError:
        return "cannot be read"
