"""Publishing: copies of results from an outputs directory to reproduce/results.

A published directory contains main.csv and ablation.csv, runs.csv (every run with its seed, metrics and times),
history.csv (the losses of every epoch), provenance.json (the provenance of every run), the figures, and a README.md
with hardware, versions and the commands to repeat the trainings. The tables of the project's README are generated from
published directories only.
"""

import dataclasses
import json
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from repro.config import NO_DECAY, PROJECTION, PROJECTION_NO_DECAY, Training
from repro.reporting.markdown import markdown_table
from repro.reporting.names import predictor_title
from repro.reporting.results import SIZES, caption, read_published, read_results, settings_text
from repro.reporting.rows import keys_of, read_rows
from repro.reporting.tables import make_tables
from repro.reporting.uptodate import STAMP
from repro.runs.directories import Outputs
from repro.runs.keys import KEY, RunKey
from repro.runs.provenance import Provenance
from repro.system.files import clear_leftovers, lock, replacing_directory, write_json, write_text


@dataclass(frozen=True)
class Recipe:
    """What the commands that repeat published trainings share.

    Args:
        scale: name of the scale.
        overrides: overrides of world and scale, each after a space.
        training: the training settings that need no override; None if unknown.
    """

    scale: str
    overrides: str = ""
    training: Training | None = None

    def options(self, name: str, networks: pd.DataFrame) -> str:
        """Return the options that repeat the trainings of one network, published in the directory of this name."""
        changed: dict[str, None] = {}
        if self.training:
            usual = settings_text(self.training).split(", ")
            settings = [each for row in networks["training"].dropna() for each in str(row).split(", ")]
            changed = dict.fromkeys(f" train.{each}" for each in settings if each and each not in usual)
        outputs = "" if name == self.scale else f" outputs=outputs/{name}"
        return f"scale={self.scale}{self.overrides}{''.join(changed).replace('=None', '=null')}{outputs}"


def publish(outputs: Outputs, results: Path, recipe: Recipe, *, force: bool = False) -> Path:
    """Publish the results of an outputs directory; they replace the published directory of the same name.

    The replacement is atomic. Exported weights, costs and verification results in the published directory are kept.

    Args:
        outputs: the outputs directory of one scale, named after the scale or after the property that its runs share.
        results: reproduce/results.
        recipe: for the commands that repeat the trainings.
        force: whether to publish despite `doubts`.

    Returns:
        the published directory.

    Raises:
        ValueError: no network is evaluated, a run is damaged or inconsistent, or there are doubts.
    """
    runs = read_results(outputs)
    if runs.empty or not (runs["encoding"] != "").any():
        raise ValueError(f"nothing to publish in {outputs.path}: no network is evaluated")
    name = outputs.path.name
    if not re.fullmatch(r"[\w-]+", name):
        raise ValueError(
            f"outputs={outputs.path}: results are published under its last part, which must be a plain name"
        )
    target = results / name
    origins = {str(key.path): outputs.run(key).provenance() for key in keys_of(runs)}
    results.mkdir(parents=True, exist_ok=True)
    with lock(results):  # from the first reading on, so that two calls do not lose runs of each other
        clear_leftovers(results)
        reasons = doubts(runs, list(origins.values()), target)
        if reasons and not force:
            raise ValueError(f"not published to {target}: {'; '.join(reasons)}; publish.force=true publishes it anyway")
        _replace(target, outputs, runs, origins, recipe)
    return target


def _replace(
    target: Path, outputs: Outputs, runs: pd.DataFrame, origins: dict[str, Provenance], recipe: Recipe
) -> None:
    """Replace a published directory; see `publish`."""
    with replacing_directory(target) as new:
        for kept in target.glob("*"):
            if (kept.is_dir() and kept.name != "analysis") or kept.stem in ("costs", "verification"):
                (shutil.copytree if kept.is_dir() else shutil.copyfile)(kept, new / kept.name)
        write_histories(outputs, keys_of(runs), new)
        for path in (*outputs.figures.glob("*.png"), *outputs.path.glob("report.html"), *outputs.worlds.glob("*.gif")):
            shutil.copyfile(path, new / path.name)
        if outputs.analysis.is_dir():
            shutil.copytree(outputs.analysis, new / "analysis", ignore=shutil.ignore_patterns("*.pdf", STAMP))
        write_runs(new, target.name, recipe, runs, origins)


def write_runs(directory: Path, name: str, recipe: Recipe, runs: pd.DataFrame, origins: dict[str, Provenance]) -> None:
    """Write the tables, runs.csv, provenance.json and README.md of a published directory.

    Args:
        directory: the directory, complete except for these files.
        name: its name.
        recipe: for the commands that repeat the trainings.
        runs: tidy rows, see `results.read_results`.
        origins: provenance of each run by its path.
    """
    for kind, table in make_tables(runs).items():
        if len(table.frame):
            write_text(directory / f"{kind}.csv", table.frame.to_csv(index=False, float_format="%.6f"))
            write_text(directory / f"{kind}.txt", table.caption + "\n")
    write_text(directory / "runs.csv", runs.to_csv(index=False, float_format="%.6g"))
    write_json(directory / "provenance.json", {path: dataclasses.asdict(origin) for path, origin in origins.items()})
    with_analysis = (directory / "analysis").is_dir()
    write_text(directory / "README.md", published_page(name, recipe, runs, origins, with_analysis=with_analysis))


def write_histories(outputs: Outputs, keys: Iterable[RunKey], directory: Path) -> None:
    """Write history.csv: losses and seconds of every epoch of some runs, after the rows that the file has."""
    path = directory / "history.csv"
    histories = [read_rows(path)] if path.is_file() else []
    for key in keys:
        history = outputs.run(key).path / "history.csv"
        if history.is_file():
            cell = {name: getattr(key, name) for name in KEY}
            histories.append(pd.read_csv(history).assign(**cell))
    if histories:
        rows = pd.concat(histories, ignore_index=True)
        rows = rows[[*KEY, *rows.columns.drop(KEY)]]
        write_text(path, rows.to_csv(index=False, float_format="%.6g"))


def has_uncommitted(origins: Iterable[Provenance]) -> bool:
    """Return whether a step of a run was made with code that was not committed."""
    return any(str(step.get("commit", "")).endswith("+") for origin in origins for step in origin.steps)


def doubts(runs: pd.DataFrame, origins: list[Provenance], target: Path) -> list[str]:
    """Return reasons against replacing the published runs by some runs.

    Args:
        runs: tidy rows, see `results.read_results`.
        origins: the provenance of the runs.
        target: the published directory, which may be missing.
    """
    reasons = ["some runs were made with uncommitted code"] if has_uncommitted(origins) else []
    if runs.loc[runs["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY]), "training"].nunique() > 1:
        reasons.append("the networks were trained with different settings")
    if (target / "runs.csv").is_file():
        before = read_published(target)
        for size, unit in SIZES.items():
            now, then = runs[size].max(), before[size].max()
            if now < then:
                reasons.append(f"the published runs have {then:.0f} {unit}, these runs have {now:.0f}")
        missing = set(keys_of(before)) - set(keys_of(runs))
        if missing:
            reasons.append(f"{len(missing)} of the {len(before)} published runs are missing")
    return reasons


def published_page(
    name: str, recipe: Recipe, runs: pd.DataFrame, origins: dict[str, Provenance], *, with_analysis: bool
) -> str:
    """Return the README.md of a published directory: files, hardware, versions, training commands.

    `origins` has the provenance of each run by its path.
    """
    networks = runs[runs["encoding"] != ""]
    ablated = networks["encoding"].str.endswith(NO_DECAY).any()
    tables = "`main.csv` and `ablation.csv` are the tables," if ablated else "`main.csv` is the table,"
    analysis = "; `analysis/` and `report.html` have the analysis" if with_analysis else ""
    commands = _training_commands(name, networks, origins, recipe)
    lines = [
        f"# Published results, {name}\n",
        caption(runs) + "\n",
        f"{tables} `runs.csv` has every run with its seed, all metrics and times,",
        f"`provenance.json` has the provenance of every run{analysis}.\n",
        *_environments(step for origin in origins.values() for step in origin.steps if step["step"] != "recorded"),
        "",
        *markdown_table(("network", "trainings", "minutes per training", "command"), commands),
    ]
    return "\n".join(lines) + "\n"


def _environments(steps: Iterable[dict[str, Any]]) -> list[str]:
    """List the hardware, versions, commits and precisions of steps; the oldest ones have a precision alone."""
    steps = list(steps)
    known = [step for step in steps if "hardware" in step]
    machines = {
        verb: sorted({json.dumps(step["hardware"], sort_keys=True) for step in known if step["step"] == verb})
        for verb in ("trained", "evaluated")
    }
    versions = [
        f"{package} {' and '.join(sorted({step['versions'][package] for step in known}))}"
        for package in ("torch", "segmentation-models-pytorch", "ir-sim")
    ]
    return [
        *(f"- {verb} on: {'; '.join(names)}" for verb, names in machines.items()),
        f"- versions: {', '.join(versions)}",
        f"- commit: {', '.join(sorted({str(step['commit']) for step in known}))}",
        f"- precision: {', '.join(sorted({step['precision'] for step in steps if 'precision' in step}))}",
    ]


def _training_commands(
    name: str, networks: pd.DataFrame, origins: dict[str, Provenance], recipe: Recipe
) -> list[tuple[str, int, str, str]]:
    """Return title, number of trainings, their mean time [min] and command of each network with each encoding."""
    rows = []
    for model, encoding in dict.fromkeys(zip(networks["model"], networks["encoding"], strict=True)):
        own_runs = networks[(networks["model"] == model) & (networks["encoding"] == encoding)]
        seeds, experiments = (",".join(map(str, sorted(own_runs[key].unique()))) for key in ("seed", "experiment"))
        base = encoding.removesuffix(NO_DECAY)
        options = ("" if base == PROJECTION else f" encoding={base}") + ("" if base == encoding else " decay=false")
        used = {origins[str(key.path)].fact("precision") for key in keys_of(own_runs) if str(key.path) in origins}
        precision = f" runtime.precision={used.pop()}" if len(used) == 1 else ""
        shared = recipe.options(name, own_runs)
        command = f"python run.py -m model={model} exp={experiments}{options} seed={seeds} {shared}{precision}"
        minutes = own_runs["training_seconds"].mean() / 60
        rows.append((predictor_title(model, encoding), len(own_runs), f"{minutes:.1f}", f"`{command}`"))
    return rows
