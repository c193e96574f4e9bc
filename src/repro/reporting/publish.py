"""Publishing: an upsert of the runs of an outputs directory into runs.csv of a directory of reproduce/results.

A published directory contains runs.csv (every run with its seed, metrics and times), from which all tables follow,
history.csv (the losses of every epoch), provenance.json (the provenance of every run), the analysis, the figures, and a
README.md with hardware, versions and the commands to repeat the trainings. The generated tables of the documents come
from published directories only.
"""

import dataclasses
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.networks.model import NETWORKS
from repro.reporting.analysis_figures import write_analysis_figures
from repro.reporting.published_readme import published_page
from repro.reporting.results import SIZES, read_origins, read_published, read_results, recordings_of
from repro.reporting.rows import conflicts, keys_of, read_rows
from repro.runs.keys import KEY, RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, read_table, replacing_directory, write_json, write_text

IDENTIFYING = (  # columns that identify what a row of the analysis is about, where a table has them
    *("experiment", "comparison", "one", "other", "model", "encoding"),
    *("seed", "trained", "shift", "tested", "source"),
)
Origins: TypeAlias = dict[str, Provenance]  # by the path of the run


@dataclasses.dataclass(frozen=True)
class _Runs:
    """Runs with their rows, see `results.read_results`, and their provenance."""

    rows: pd.DataFrame
    origins: Origins

    @property
    def keys(self) -> set[RunKey]:
        return set(keys_of(self.rows))

    def without(self, keys: set[RunKey]) -> "_Runs":
        """Return the runs with other keys."""
        paths = {str(key.path) for key in keys}
        rows = self.rows[np.array([key not in keys for key in keys_of(self.rows)], dtype=bool)]
        return _Runs(rows, {path: origin for path, origin in self.origins.items() if path not in paths})

    def and_those(self, others: "_Runs") -> "_Runs":
        """Return these runs and others, sorted."""
        parts = [runs.rows for runs in (self, others) if len(runs.rows)]
        return _Runs(pd.concat(parts, ignore_index=True).sort_values(KEY), {**self.origins, **others.origins})


NONE = _Runs(pd.DataFrame(columns=KEY), {})


def publish(outputs: Outputs, results: Path, *, force: bool = False) -> Path:
    """Publish the runs of an outputs directory in the directory of the same name; runs with the same key are replaced.

    If the outputs hold every published run, their analysis, figures and report replace the published ones. Else these
    gain the rows of the analysis that they lack, and the figures of the analysis are drawn anew. Weights, animations,
    costs and results of verification stay. The replacement of the directory is atomic.

    Args:
        outputs: the outputs directory of one scale, named after the scale or after the property that its runs share; it
            may have an analysis of published runs alone, such as a test of generalization.
        results: reproduce/results.
        force: whether to publish runs of uncommitted code or other settings, and to replace all published runs by runs
            of another size or on other recordings.

    Returns:
        the published directory.

    Raises:
        ValueError: no network is evaluated or published, a run is damaged, or without force there are doubts.
    """
    name = outputs.path.name
    if not re.fullmatch(r"[\w-]+", name):
        raise InputError(
            f"outputs={outputs.path}: results are published under its last part, which must be a plain name"
        )
    target = results / name
    results.mkdir(parents=True, exist_ok=True)
    with lock(results):  # from the first reading on, so that two calls do not lose runs of each other
        clear_leftovers(results)
        found, published = _read(outputs), _read_published(target)
        has_network = any((runs.rows["encoding"] != "").any() for runs in (found, published))
        if not has_network or not (found.keys or outputs.analysis.is_dir()):
            raise InputError(f"nothing to publish in {outputs.path}: no network is evaluated")
        differences = list(_differences(found, published))
        kept = NONE if differences else published.without(found.keys)
        doubts = [*differences, *_doubts(found, kept)]
        if doubts and not force:
            raise InputError(f"not published to {target}: {'; '.join(doubts)}; publish.force=true publishes it anyway")
        with replacing_directory(target) as new:
            if target.is_dir():
                shutil.copytree(target, new, dirs_exist_ok=True)
            histories = _histories(outputs, found, kept, new)
            if kept.keys:
                _add_analysis(outputs.analysis, new / "analysis")
            else:
                _replace_files(outputs, new)
            _write(new, name, kept.and_those(found), histories)
    return target


def _read(outputs: Outputs) -> _Runs:
    rows = read_results(outputs)
    return _Runs(rows, {str(key.path): outputs.run(key).provenance() for key in keys_of(rows)}) if len(rows) else NONE


def _read_published(directory: Path) -> _Runs:
    """Read the published runs of a directory; none if nothing is published there."""
    if not (directory / "runs.csv").is_file():
        return NONE
    rows = read_published(directory)
    return _Runs(rows, read_origins(directory, keys_of(rows)))


def _differences(found: _Runs, published: _Runs) -> Iterator[str]:
    """Yield why runs cannot stand beside the published ones, which they replace with force."""
    if not found.keys or not published.keys:
        return
    for fact, words in {**SIZES, "scale": "as scale"}.items():
        now, then = (sorted(set(runs.rows[fact].dropna())) for runs in (found, published))
        if not set(now) <= set(then):
            yield f"the published runs have {_listed(then)} {words}, these runs {_listed(now)}"
    kept = published.without(found.keys).origins
    for path, origin in found.origins.items():
        experiment = RunKey.parse(path).experiment
        others = recordings_of(kept, experiment)
        if others and origin.fact("recordings") not in others:
            yield f"{path} has other recordings than the published runs of experiment {experiment}"


def _doubts(found: _Runs, kept: _Runs) -> Iterator[str]:
    """Yield reasons against publishing runs, which remain with those that are kept."""
    if any(str(step.get("commit", "")).endswith("+") for origin in found.origins.values() for step in origin.steps):
        yield "some runs were made with uncommitted code"
    settings: dict[str, list[object]] = {}
    rows = kept.and_those(found).rows
    for key, cell in zip(keys_of(rows), rows.get("settings", [""] * len(rows)), strict=True):
        settings.setdefault(_trained_alike(key), []).append(cell)
    for kind in sorted(set(map(_trained_alike, found.keys))):
        if listing := conflicts(settings[kind]):
            yield f"{kind} was trained with different settings: {listing}"


def _trained_alike(key: RunKey) -> str:
    """Name the runs that must share all settings with a run: those of the paper's method, or its other seeds."""
    is_papers = key.model in NETWORKS and key.encoding in (PROJECTION, PROJECTION_NO_DECAY)
    return "the paper's method" if is_papers else str(key.path.parent)


def _listed(values: list[Any]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)


def _replace_files(outputs: Outputs, directory: Path) -> None:
    """Replace analysis, figures and report of a published directory by those of the outputs."""
    for path in directory.iterdir():
        is_measured = path.stem in ("costs", "verification") or path.suffix == ".gif"
        if path.name == "analysis":
            shutil.rmtree(path)
        elif path.is_file() and not is_measured:
            path.unlink()
    for path in (*outputs.figures.glob("*.png"), *outputs.path.glob("report.html"), *outputs.worlds.glob("*.gif")):
        shutil.copyfile(path, directory / path.name)
    if outputs.analysis.is_dir():
        passed_over = shutil.ignore_patterns("*.pdf", "*.tmp", "*.lock", ".*")
        shutil.copytree(outputs.analysis, directory / "analysis", ignore=passed_over)


def _add_analysis(source: Path, target: Path) -> None:
    """Add to the published tables of the analysis the rows of what they lack, and draw its figures anew."""
    for path in sorted(source.glob("*.csv")) if target.is_dir() else ():
        rows: Any = read_rows(path)
        if {"model", "encoding"} <= set(rows):  # else it follows from other tables
            earlier = [read_rows(target / path.name)] if (target / path.name).is_file() else []
            columns = [name for name in IDENTIFYING if all(name in table for table in (rows, *earlier))]
            present = {each for table in earlier for each in _tuples(table, columns)}
            table = pd.concat([*earlier, rows[[each not in present for each in _tuples(rows, columns)]]])
            write_text(target / path.name, table.to_csv(index=False, float_format="%.6g"))
    if source.is_dir() and target.is_dir():
        names = [path.stem for path in target.glob("*.png")]
        write_analysis_figures(target, {path.stem: read_rows(path) for path in target.glob("*.csv")}, names, ("png",))


def _tuples(rows: pd.DataFrame, columns: list[str]) -> list[tuple[Any, ...]]:
    return list(rows[columns].astype(object).fillna("").itertuples(index=False, name=None))


def _histories(outputs: Outputs, found: _Runs, kept: _Runs, directory: Path) -> pd.DataFrame | None:
    """Return losses and seconds of every epoch of the kept runs and the new ones; None if none has any."""
    path, histories = directory / "history.csv", []
    if path.is_file():
        rows = read_rows(path)
        histories.append(rows[np.array([key in kept.keys for key in keys_of(rows)], dtype=bool)])
    for key in keys_of(found.rows):
        history = outputs.run(key).path / "history.csv"
        if history.is_file():
            cell = {name: getattr(key, name) for name in KEY}
            histories.append(read_table(history, ("epoch", "val_loss"), "delete it").assign(**cell))
    if not histories:
        return None
    rows = pd.concat(histories, ignore_index=True)
    return rows[[*KEY, *rows.columns.drop(list(KEY))]]


def _write(directory: Path, name: str, runs: _Runs, histories: pd.DataFrame | None) -> None:
    """Write runs.csv, history.csv, provenance.json and README.md of a published directory."""
    counts = {name: "Int64" for name in ("train_pairs", "epochs") if name in runs.rows}  # missing for baselines
    for stem, table in {"runs": runs.rows.astype(counts), "history": histories}.items():
        if table is not None:
            write_text(directory / f"{stem}.csv", table.to_csv(index=False, float_format="%.6g"))
    content = {path: dataclasses.asdict(origin) for path, origin in runs.origins.items()}
    write_json(directory / "provenance.json", content)
    analyzed = ""
    if (directory / "analysis").is_dir():
        has_page = (directory / "report.html").is_file()
        analyzed = "`analysis/` and `report.html` have" if has_page else "`analysis/` has"
    write_text(directory / "README.md", published_page(name, runs.rows, runs.origins, analyzed))
