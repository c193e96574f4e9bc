"""Status of a study: recordings, state of each run, and estimated remaining time."""

import dataclasses
from collections import Counter

from repro.baselines.names import rank
from repro.config import PairCounts
from repro.recordings.format import holds, recordings_in
from repro.recordings.reader import read_manifest
from repro.reporting.names import duration, model_title
from repro.reporting.render import Cells
from repro.reporting.study import Study
from repro.runs.directories import Run
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.system.errors import InputError


def describe_outputs(study: Study, pairs: PairCounts) -> str:
    """Return the state of all recordings and runs of an outputs directory as Markdown.

    Args:
        study: the trainings that are counted; the table includes all other runs and seeds.
        pairs: planned number of recordings per experiment.
    """
    outputs, planned = study.outputs, study.runs()
    recorded = [(experiment, _recorded(outputs, experiment, pairs)) for experiment in study.experiments]
    existing, others = outputs.named_runs()
    states = {key: _state(run) for key, run in (planned | existing).items()}
    seeds = sorted({key.seed for key in states if key.seed is not None})
    rows: dict[tuple[str, str, str], dict[int | None, str]] = {}
    for key, state in states.items():
        rows.setdefault((key.experiment, key.encoding, key.model), {})[key.seed] = state
    shown = []
    for (experiment, encoding, model), row in sorted(rows.items(), key=lambda item: (*item[0][:2], rank(item[0][2]))):
        cells = [row.get(seed, "") for seed in seeds] if encoding else [row[None], *[""] * (len(seeds) - 1)]
        shown.append((experiment, encoding, model_title(model), *cells))
    lines = [f"{outputs.path}", "", Cells(("exp.", "recordings"), recorded).to_markdown()]
    lines += [Cells(("exp.", "input", "model", *(f"seed {seed}" for seed in seeds)), shown).to_markdown()]
    counted = Counter(states[key].split(",")[0] for key in planned)
    lines += [f"Of the study's {len(planned)} trainings with seed {study.seed}: {_listed(counted)}."]
    left = study.seconds_left()
    if left:
        lines.append(f"About {duration(left)} of training remain, estimated from finished trainings.")
    lines += [f"{path} is passed over: its name is not that of a run." for path in others]
    return "\n".join(lines)


def _recorded(outputs: Outputs, experiment: str, pairs: PairCounts) -> str:
    directory, wanted = outputs.recordings(experiment), dataclasses.asdict(pairs)
    if (directory / "manifest.json").is_file():
        try:
            if holds(read_manifest(directory).pairs, wanted):
                return "complete"
        except InputError:
            return "cannot be read"
    recorded = recordings_in(directory, wanted)
    return f"{recorded} of {sum(wanted.values())}" if recorded else "missing"


def _state(run: Run) -> str:
    """Return the status of a run in a few words."""
    if not run.path.is_dir():
        return "missing"
    try:
        status = run.status
        if status in (Status.training, Status.paused):
            history = run.path / "history.csv"
            epochs = max(len(history.read_text(encoding="utf-8").splitlines()) - 1, 0) if history.is_file() else 0
            return f"{status}, {epochs} epochs"
        return str(status) if status is not Status.evaluated or run.is_evaluated else "evaluated, metrics missing"
    except ValueError:
        return "cannot be read"


def _listed(counted: Counter[str]) -> str:
    return ", ".join(f"{count} {state}" for state, count in counted.most_common())
