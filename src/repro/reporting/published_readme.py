"""The README.md of a published directory: files, hardware, versions, and the commands that repeat the trainings."""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from repro.config import NO_DECAY, PROJECTION
from repro.reporting.names import predictor_title, scale_options
from repro.reporting.render import Cells
from repro.reporting.rows import Settings, changed, keys_of, read_cells
from repro.reporting.tables import caption
from repro.runs.provenance import Provenance


def _no_settings(model: str, encoding: str) -> Settings:
    return {}


@dataclass(frozen=True)
class Recipe:
    """What the commands that repeat published trainings share.

    Args:
        scale: name of the scale.
        overrides: overrides of world and scale, each after a space.
        usual: from the names of a network and an encoding to the settings that need no override, see
            `reporting.rows`; None if their code has been deleted since.
    """

    scale: str
    overrides: str = ""
    usual: Callable[[str, str], Settings | None] = _no_settings

    def options(self, name: str, model: str, encoding: str, settings: Settings) -> str:
        """Return the options that repeat a training that is published in the directory of this name."""
        usual = self.usual(model, encoding)
        own = {} if usual is None else changed(settings, usual)
        return scale_options(self.scale, Path("outputs", name), self.overrides + "".join(overrides(own)))


def overrides(settings: Settings) -> Iterator[str]:
    """Yield settings as overrides on the command line, each after a space."""
    for key, value in settings.items():
        yield f" {key}={value if isinstance(value, str) else json.dumps(value)}"


def published_page(
    name: str, recipe: Recipe, runs: pd.DataFrame, origins: dict[str, Provenance], analyzed: str = ""
) -> str:
    """Return the README.md of a published directory: files, hardware, versions, training commands.

    `origins` has the provenance of each run by its path, and `analyzed` names what has the analysis, with the verb.
    """
    networks = runs[runs["encoding"] != ""]
    analysis = f"; {analyzed} the analysis" if analyzed else ""
    commands = _training_commands(name, networks, origins, recipe)
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
        verb: sorted({_machine(**step["hardware"]) for step in known if step["step"] == verb})
        for verb in ("trained", "evaluated")
    }
    versions = [
        f"{package} {' and '.join(sorted({step['versions'][package] for step in known}))}"
        for package in ("torch", "segmentation-models-pytorch", "ir-sim")
    ]
    return [
        *(f"- {verb} on: {'; '.join(names) or 'not recorded'}" for verb, names in machines.items()),
        f"- versions: {', '.join(versions)}",
        f"- commits: {', '.join(sorted({_short(str(step['commit'])) for step in known}))}",
        f"- precision: {', '.join(sorted({step['precision'] for step in steps if 'precision' in step}))}",
    ]


def _machine(
    gpu: str | None, cpu: str | None = None, cpu_cores: int = 0, threads: int | None = None, machine: str = ""
) -> str:
    """Describe the hardware of a step, see `devices.hardware`; the oldest steps have no name of the CPU."""
    used = "" if threads is None else f", {threads} used"
    return gpu or f"{cpu or f'CPU ({machine})'}, {cpu_cores} cores{used}"


def _short(commit: str) -> str:
    """Shorten a commit to ten digits; a plus stands for uncommitted changes."""
    return commit[:10] + ("+" if commit.endswith("+") else "")


def _training_commands(
    name: str, networks: pd.DataFrame, origins: dict[str, Provenance], recipe: Recipe
) -> list[tuple[str, int, str, str]]:
    """Return title, number of trainings, their mean time [min] and command of trainings that one command repeats."""
    settings = read_cells(networks["settings"]) if "settings" in networks else [{}] * len(networks)
    encodings = networks["encoding"].str.removesuffix(NO_DECAY)
    paths = [str(key.path) for key in keys_of(networks)]
    precisions = [origins[path].fact("precision") if path in origins else None for path in paths]
    named = zip(networks["model"], encodings, settings, precisions, strict=True)
    networks = networks.assign(
        options=[
            recipe.options(name, model, encoding, own) + (f" runtime.precision={precision}" if precision else "")
            for model, encoding, own, precision in named
        ]
    )
    alike = ["model", "encoding", "options"]
    seeds = networks.groupby([*alike, "experiment"])["seed"].transform(lambda each: ",".join(map(str, sorted(each))))
    rows = []
    for _, runs in networks.assign(seeds=seeds).groupby([*alike, "seeds"], sort=False):
        model, encoding, options, of_seeds = runs[[*alike, "seeds"]].iloc[0]
        base = encoding.removesuffix(NO_DECAY)
        data = ("" if base == PROJECTION else f" encoding={base}") + ("" if base == encoding else " decay=false")
        experiments = ",".join(sorted(runs["experiment"].unique()))
        command = f"`python run.py -m model={model} exp={experiments}{data} seed={of_seeds} {options}`"
        if recipe.usual(model, base) is None:
            command += " with the code of their commit"
        minutes = f"{runs['training_seconds'].mean() / 60:.1f}"
        rows.append((predictor_title(model, encoding), len(runs), minutes, command))
    titles = [row[0] for row in rows]
    return sorted(rows, key=lambda row: titles.index(row[0]))
