"""Where a study stands: what is recorded, trained, evaluated, what is missing, and how long what is left will take."""

import dataclasses
from collections import Counter

from repro.config import PairCounts
from repro.names import NAMES
from repro.provenance import Status
from repro.runs import Outputs, Run
from repro.simulation.shards import recordings_in
from repro.studies import CELLS, Study


def describe_outputs(outputs: Outputs, experiments: list[str], pairs: PairCounts, seed: int) -> str:
    """Writes what is recorded, trained, paused, failed, evaluated and missing in an outputs directory.

    Args:
        outputs: the outputs directory.
        experiments: the experiments that there are.
        pairs: how many recordings each is to have.
        seed: of the study whose 24 cells are counted; the table has all seeds.
    """
    lines = [f"{outputs.path}", "", "| exp. | recordings |", "|---|---|"]
    for experiment in experiments:
        lines.append(f"| {experiment} | {_recorded(outputs, experiment, pairs)} |")
    found = {run.path: run for run in (*Study(outputs, seed).runs().values(), *outputs.runs())}
    states = {run: _state(run) for run in found.values()}
    seeds = sorted({run.path.name for run in found.values()}, key=lambda name: int(name.removeprefix("seed")))
    rows: dict[tuple[str, str, str], dict[str, str]] = {}
    for run, state in states.items():
        experiment, model, variant, name = run.path.parts[-4:]
        rows.setdefault((experiment.removeprefix("exp"), model, variant), {})[name] = state
    lines += ["", "| exp. | model | input | " + " | ".join(seeds) + " |", "|---" * (3 + len(seeds)) + "|"]
    for (experiment, model, variant), row in sorted(rows.items(), key=_order):
        cells = " | ".join(row.get(name, "") for name in seeds)
        lines.append(f"| {experiment} | {NAMES.get(model, model)} | {variant} | {cells} |")
    counted = Counter(_state(run).split(",")[0] for run in Study(outputs, seed).runs().values())
    left = Study(outputs, seed).seconds_left()
    lines += ["", f"Of the study's {len(CELLS)} trainings with seed {seed}: " + _listed(counted) + "."]
    if left:
        lines.append(f"About {left / 60:.0f} min of training are left, as measured so far.")
    return "\n".join(lines)


def _recorded(outputs: Outputs, experiment: str, pairs: PairCounts) -> str:
    directory = outputs.recordings(experiment)
    if (directory / "manifest.json").is_file():
        return "complete"
    wanted = dataclasses.asdict(pairs)
    there = recordings_in(directory, wanted)
    return f"{there} of {sum(wanted.values())}" if there else "missing"


def _state(run: Run) -> str:
    """Says where a run stands, in a word or two."""
    if not run.path.is_dir():
        return "missing"
    try:
        status = run.status
        if status in (Status.training, Status.paused):
            history = run.path / "history.csv"
            epochs = max(len(history.read_text().splitlines()) - 1, 0) if history.is_file() else 0
            return f"{status}, {epochs} epochs"
        return str(status) if status is not Status.evaluated or run.is_evaluated else "evaluated, metrics lost"
    except ValueError:
        return "cannot be read"


def _order(item: tuple[tuple[str, str, str], dict[str, str]]) -> tuple[str, str, int]:
    experiment, model, variant = item[0]
    return (experiment, variant, list(NAMES).index(model) if model in NAMES else len(NAMES))


def _listed(counted: Counter[str]) -> str:
    return ", ".join(f"{count} {state}" for state, count in counted.most_common())
