"""Additions to published results: new runs beside the published ones, for studies that are trained piece by piece."""

import shutil
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from repro.reporting.analysis_figures import write_analysis_figures
from repro.reporting.publish import has_uncommitted, write_histories, write_runs
from repro.reporting.published_readme import Recipe
from repro.reporting.results import SIZES, read_origins, read_published, read_results, recordings_of
from repro.reporting.rows import keys_of, read_rows
from repro.reporting.settings import conflicts
from repro.runs.keys import KEY, RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, replacing_directory, write_text

IDENTIFYING = (  # columns that identify what a row of the analysis is about, where a table has them
    *("experiment", "comparison", "one", "other", "model", "encoding"),
    *("seed", "trained", "shift", "tested", "source", "pairs", "size_px"),
)
Origins: TypeAlias = dict[str, Provenance]  # by the path of the run


def add_to_published(outputs: Outputs, results: Path, recipe: Recipe, *, force: bool = False) -> Path:
    """Add what is not published yet of an outputs directory to the published directory of the same name.

    This may be rows of the analysis alone, such as a learning curve. Tables, runs, provenance and the README.md are
    made anew from all runs. To the tables of the analysis, the rows are added of what they do not have yet, such as
    another network, and its figures are drawn anew; the other figures and the samples of the report stay those of the
    earlier publication. `task=docs` makes the rest of the report anew.

    Args:
        outputs: the outputs directory with the new runs, or with an analysis of published runs.
        results: reproduce/results.
        recipe: for the commands that repeat the trainings.
        force: whether to add runs of uncommitted code.

    Returns:
        the published directory.

    Raises:
        ValueError: there is nothing new, the runs are not comparable with the published ones or of uncommitted code, or
            nothing is published.
    """
    target = results / outputs.path.name
    found = read_results(outputs)
    if found.empty and not outputs.analysis.is_dir():
        raise InputError(f"nothing to add from {outputs.path}: no run is evaluated")
    read_published(target)  # before a lock is created where nothing is published
    with lock(results):  # from the first reading on, so that two calls do not lose runs of each other
        clear_leftovers(results)
        published = read_published(target)
        known = set(keys_of(published))
        new = published[:0] if found.empty else found[[key not in known for key in keys_of(found)]]
        analysis = _analysis(outputs.analysis, target / "analysis")
        earlier = read_origins(target, known)
        origins = {str(key.path): outputs.run(key).provenance() for key in keys_of(new)}
        if new.empty and not analysis:
            raise InputError(f"nothing added to {target}: all evaluated runs are published")
        problem = _problem(new, published, origins, earlier, force=force)
        if problem:
            raise InputError(f"not added to {target}: {problem}")
        every = {**earlier, **origins}
        runs = pd.concat([published, new], ignore_index=True).sort_values(KEY)
        with replacing_directory(target) as directory:
            shutil.copytree(target, directory, dirs_exist_ok=True)
            write_histories(outputs, keys_of(new), directory)
            if analysis:
                _write_analysis(analysis, directory / "analysis")
            write_runs(directory, target.name, recipe, runs, every)
    return target


def _problem(
    new: pd.DataFrame, published: pd.DataFrame, origins: Origins, earlier: Origins, *, force: bool
) -> str | None:
    """Return why the new runs cannot share tables with the published ones; None if they can."""
    for fact, words in {**SIZES, "scale": "as scale"}.items():
        now, then = (sorted(set(rows[fact].dropna())) for rows in (new, published))
        if not set(now) <= set(then):
            return f"the published runs have {_listed(then)} {words}, the new runs {_listed(now)}"
    for path, origin in origins.items():
        experiment = RunKey.parse(path).experiment
        others = recordings_of(earlier, experiment)
        if others and origin.fact("recordings") not in others:
            return f"{path} has other recordings than the published runs of experiment {experiment}"
    for _, rows in pd.concat([published, new]).groupby(["model", "encoding"]):
        listing = conflicts(rows["settings"])
        if listing:
            return f"{rows['model'].iloc[0]} was trained with different settings: {listing}"
    if not force and has_uncommitted(origins.values()):
        return "some runs were made with uncommitted code; publish.force=true adds them anyway"
    return None


def _listed(values: list[Any]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)


def _analysis(source: Path, target: Path) -> dict[str, pd.DataFrame]:
    """Return the published tables of the analysis, by name, that gain rows of what they do not have."""
    tables = {}
    for path in sorted(source.glob("*.csv")) if target.is_dir() else ():
        rows: Any = read_rows(path)
        if not {"model", "encoding"} <= set(rows):
            continue
        earlier = [read_rows(target / path.name)] if (target / path.name).is_file() else []
        columns = [name for name in IDENTIFYING if all(name in table for table in (rows, *earlier))]
        present = {each for table in earlier for each in _tuples(table, columns)}
        is_new = [each not in present for each in _tuples(rows, columns)]
        if any(is_new):
            tables[path.stem] = pd.concat([*earlier, rows[is_new]], ignore_index=True)
    return tables


def _write_analysis(tables: dict[str, pd.DataFrame], target: Path) -> None:
    """Write tables of the analysis, and draw its figures anew."""
    for name, table in tables.items():
        write_text(target / f"{name}.csv", table.to_csv(index=False, float_format="%.6g"))
    names = [path.stem for path in target.glob("*.png")]
    write_analysis_figures(target, {path.stem: read_rows(path) for path in target.glob("*.csv")}, names, ("png",))


def _tuples(rows: pd.DataFrame, columns: list[str]) -> list[tuple[Any, ...]]:
    return list(rows[columns].astype(object).fillna("").itertuples(index=False, name=None))
