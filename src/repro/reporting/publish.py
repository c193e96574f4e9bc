"""Publishing: copies of results from an outputs directory to reproduce/results.

A published directory contains main.csv and ablation.csv, runs.csv (every run with its seed, metrics and times),
history.csv (the losses of every epoch), provenance.json (the provenance of every run), the figures, and a README.md
with hardware, versions and the commands to repeat the trainings. The tables of the project's README are generated from
published directories only.
"""

import dataclasses
import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.networks.model import NETWORKS
from repro.reporting.published_readme import Recipe, published_page
from repro.reporting.results import SIZES, read_published, read_results
from repro.reporting.rows import keys_of, read_rows
from repro.reporting.settings import conflicts
from repro.reporting.tables import make_tables
from repro.reporting.uptodate import STAMP
from repro.runs.keys import KEY, RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, read_table, replacing_directory, write_json, write_text


def publish(outputs: Outputs, results: Path, recipe: Recipe, *, force: bool = False) -> Path:
    """Publish the results of an outputs directory; they replace the published directory of the same name.

    The replacement is atomic. Weights, animations, costs and verification results in the published directory are kept.

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
        raise InputError(f"nothing to publish in {outputs.path}: no network is evaluated")
    name = outputs.path.name
    if not re.fullmatch(r"[\w-]+", name):
        raise InputError(
            f"outputs={outputs.path}: results are published under its last part, which must be a plain name"
        )
    target = results / name
    origins = {str(key.path): outputs.run(key).provenance() for key in keys_of(runs)}
    results.mkdir(parents=True, exist_ok=True)
    with lock(results):  # from the first reading on, so that two calls do not lose runs of each other
        clear_leftovers(results)
        reasons = doubts(runs, list(origins.values()), target)
        if reasons and not force:
            raise InputError(f"not published to {target}: {'; '.join(reasons)}; publish.force=true publishes it anyway")
        _replace(target, outputs, runs, origins, recipe)
    return target


def _replace(
    target: Path, outputs: Outputs, runs: pd.DataFrame, origins: dict[str, Provenance], recipe: Recipe
) -> None:
    """Replace a published directory; see `publish`."""
    with replacing_directory(target) as new:
        for kept in target.glob("*"):
            is_measured = kept.stem in ("costs", "verification") or kept.suffix == ".gif"
            if (kept.is_dir() and kept.name != "analysis") or is_measured:
                (shutil.copytree if kept.is_dir() else shutil.copyfile)(kept, new / kept.name)
        write_histories(outputs, keys_of(runs), new)
        for path in (*outputs.figures.glob("*.png"), *outputs.path.glob("report.html"), *outputs.worlds.glob("*.gif")):
            shutil.copyfile(path, new / path.name)
        if outputs.analysis.is_dir():
            shutil.copytree(
                outputs.analysis, new / "analysis", ignore=shutil.ignore_patterns("*.pdf", "*.tmp", "*.lock", STAMP)
            )
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
    analyzed = ""
    if (directory / "analysis").is_dir():
        has_page = (directory / "report.html").is_file()
        analyzed = "`analysis/` and `report.html` have" if has_page else "`analysis/` has"
    write_text(directory / "README.md", published_page(name, recipe, runs, origins, analyzed))


def write_histories(outputs: Outputs, keys: Iterable[RunKey], directory: Path) -> None:
    """Write history.csv: losses and seconds of every epoch of some runs, after the rows that the file has."""
    path = directory / "history.csv"
    histories = [read_rows(path)] if path.is_file() else []
    for key in keys:
        history = outputs.run(key).path / "history.csv"
        if history.is_file():
            cell = {name: getattr(key, name) for name in KEY}
            histories.append(read_table(history, ("epoch", "val_loss"), "delete it").assign(**cell))
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
    of_paper = runs[runs["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY]) & runs["model"].isin(NETWORKS)]
    listing = conflicts(of_paper["settings"])
    if listing:
        reasons.append(f"the networks were trained with different settings: {listing}")
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
