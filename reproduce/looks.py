"""Drive validation courses with and without a cost of unseen obstacles, each map with the settings chosen for it.

    python -m reproduce.looks MAPPER COURSES LOOKS AGES [p]

takes the courses per world, weights and ages [s] with commas between, and `p` for the network's probabilities of unseen
pixels in place of 1. Needs the outputs of `make navigation`; writes a row of each setting to outputs/looks/MAPPER.csv.
"""

import dataclasses
import sys
from pathlib import Path

import pandas as pd

from repro.cli.compose import composed
from repro.cli.jobs import Job
from repro.cli.main import read_arguments, read_calls
from repro.cli.tasks.navigate import mapper_of
from repro.metrics.bootstrap import bounds, draw_weights
from repro.navigation.surfaces import Surface, spl
from repro.navigation.trials import EPISODES, Trials
from repro.recordings.datasets import grid_of
from repro.runs.devices import few_threads
from reproduce.replay import CALL

OUT = Path("outputs/looks")


def main(which: str, courses: int, looks: list[str], ages: list[str], has_prior: bool) -> None:
    """Drive the courses and write the table."""
    parsed = read_arguments([*CALL, f"navigation.mapper={which}"])
    with composed(parsed) as jobs:
        job = Job(read_calls(parsed, jobs)[0])
    grid = grid_of(job.config)
    name, mapper = mapper_of(job, grid, which)
    specs = {name: job.call.specs[name] for name in job.call.navigation.experiments}
    known = pd.read_csv(job.outputs.path / "navigation" / name / EPISODES).query("split == 'validation'")
    without = Surface.of(known).chosen[0]
    labels = [without, *(f"{without} look={look} unseen_s={age}" for look in looks for age in ages)]
    keys = [("validation", world, number, label) for label in labels for world in specs for number in range(courses)]
    title = f"{name} {'probability' if has_prior else 'age'}"
    trials = Trials(OUT, title, dataclasses.replace(mapper, has_prior=has_prior), specs, grid)
    trials.directory.mkdir(parents=True, exist_ok=True)
    with few_threads():
        driven = trials.episodes(keys)
    reached = (driven["outcome"] == "goal").astype(float)
    driven = driven.assign(success=reached, timeout=driven["outcome"] == "timeout", score=reached + 0.1 * spl(driven))
    tables = {value: driven.pivot(index=["experiment", "seed"], columns="settings", values=value)
              for value in ("success", "timeout", "score", "time_s")}  # fmt: skip
    rows = []
    for label in labels:
        row = {"mapper": name, "expected": title.split()[1], "settings": label, "courses": len(tables["success"])}
        row |= {value: tables[value][label].mean() for value in ("success", "timeout")}
        for value in ("success", "score"):
            gain = (tables[value][label] - tables[value][without]).to_numpy()
            low, high = bounds(draw_weights(len(gain)) @ gain / len(gain))
            row |= {f"{value}_gain": gain.mean(), f"{value}_gain_low": low, f"{value}_gain_high": high}
        rows.append(row)
    table = pd.DataFrame(rows)
    table.to_csv(OUT / f"{title}.csv", index=False, float_format="%.4g")
    print(table.to_string(), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3].split(","), sys.argv[4].split(","), sys.argv[5:] == ["p"])
