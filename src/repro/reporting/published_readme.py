"""The README.md of a published directory: files, hardware, versions, and the commands that repeat the trainings."""

import shlex
from collections.abc import Iterable
from typing import Any

import pandas as pd

from repro.reporting.names import machine_title, predictor_title, short_commit
from repro.reporting.render import Cells
from repro.reporting.rows import keys_of
from repro.reporting.tables import caption
from repro.runs.provenance import Provenance

PASSED_OVER = ("model=", "exp=", "seed=", "task=", "scale=", "outputs=", "recordings=", "runtime.", "hydra")


def published_page(name: str, runs: pd.DataFrame, origins: dict[str, Provenance], analyzed: str = "") -> str:
    """Return the README.md of a published directory: files, hardware, versions, training commands.

    `origins` has the provenance of each run by its path, and `analyzed` names what has the analysis, with the verb.
    """
    analysis = f"; {analyzed} the analysis" if analyzed else ""
    commands = _training_commands(name, runs[runs["encoding"] != ""], origins)
    lines = [
        f"# Published results, {name}\n",
        caption(runs) + "\n",
        "`runs.csv` has every run with its seed, all metrics and times,",
        f"`provenance.json` has the provenance of every run{analysis}.\n",
        *_environments(step for origin in origins.values() for step in origin.steps if step["step"] != "recorded"),
        "",
        Cells(("network", "trainings", "minutes per training", "command"), commands).to_markdown(),
    ]
    return "\n".join(lines)


def _environments(steps: Iterable[dict[str, Any]]) -> list[str]:
    """List the hardware, versions, commits and precisions of steps; the oldest ones have a precision alone."""
    steps = list(steps)
    known = [step for step in steps if "hardware" in step]
    machines = {
        verb: sorted({machine_title(**step["hardware"]) for step in known if step["step"] == verb})
        for verb in ("trained", "evaluated")
    }
    versions = [
        f"{package} {' and '.join(sorted({step['versions'][package] for step in known}))}"
        for package in ("torch", "segmentation-models-pytorch", "ir-sim")
    ]
    return [
        *(f"- {verb} on: {'; '.join(names) or 'not recorded'}" for verb, names in machines.items()),
        f"- versions: {', '.join(versions)}",
        f"- commits: {', '.join(sorted({short_commit(step['commit']) for step in known}))}",
        f"- precision: {', '.join(sorted({step['precision'] for step in steps if 'precision' in step}))}",
    ]


def _training_commands(
    name: str, networks: pd.DataFrame, origins: dict[str, Provenance]
) -> list[tuple[str, int, str, str]]:
    """Return title, number of trainings, their mean time [min] and command of trainings that one command repeats."""
    paths = [str(key.path) for key in keys_of(networks)]
    options = [_options(name, scale, origins[path]) for scale, path in zip(networks["scale"], paths, strict=True)]
    networks = networks.assign(options=options)
    alike = ["model", "encoding", "options"]
    seeds = networks.groupby([*alike, "experiment"])["seed"].transform(lambda each: ",".join(map(str, sorted(each))))
    rows = []
    for _, runs in networks.assign(seeds=seeds).groupby([*alike, "seeds"], sort=False):
        model, encoding, of_all, of_seeds = runs[[*alike, "seeds"]].iloc[0]
        experiments = ",".join(sorted(runs["experiment"].unique()))
        command = f"`python run.py -m model={model} exp={experiments} seed={of_seeds}{of_all}`"
        minutes = f"{runs['training_seconds'].mean() / 60:.1f}"
        rows.append((predictor_title(model, encoding), len(runs), minutes, command))
    titles = [row[0] for row in rows]
    return sorted(rows, key=lambda row: titles.index(row[0]))


def _options(name: str, scale: str, origin: Provenance) -> str:
    """Return the overrides of a training that is published in the directory of this name, each after a space.

    Those that name network, experiment, seed, machine or place are left out; the precision and the place are added.
    """
    typed = [each for each in shlex.split(origin.fact("command") or "")[2:] if not each.startswith(PASSED_OVER)]
    precision = origin.fact("precision")
    added = [f"runtime.precision={precision}"] if precision else []
    added += [] if name == scale else [f"outputs=outputs/{name}"]
    return "".join(f" {shlex.quote(each)}" for each in (f"scale={scale}", *typed, *added))
