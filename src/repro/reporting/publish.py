"""Publishing: an upsert of the runs of an outputs directory by `RunKey` into a directory of reproduce/results.

A published directory contains runs.csv (every run with its seed, metrics and times), from which all tables follow,
provenance.json (the provenance of every run), the analysis, the figures, and a README.md. The generated tables of the
documents come from published directories only.
"""

import dataclasses
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from repro.reporting.analysis_figures import write_analysis_figures
from repro.reporting.results import (
    conflicts,
    keys_of,
    read_origins,
    read_published,
    read_results,
    read_rows,
    recordings_of,
)
from repro.reporting.tables import caption
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.keys import KEY, RunKey
from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, replacing_directory, write_json, write_text

SIZES = {"size_px": "px", "train_pairs": "training pairs", "test_pairs": "test pairs", "scale": "as scale"}
IDENTIFYING = (  # columns that identify what a row of the analysis is about, where a table has them
    *("experiment", "comparison", "one", "other", "model", "encoding"),
    *("seed", "trained", "shift", "tested"),
)
Origins = dict[str, Provenance]  # by the path of the run


def publish(outputs: Outputs, results: Path, *, force: bool = False) -> Path:
    """Publish the runs of an outputs directory in the directory of the same name; runs with the same key are replaced.

    If the outputs hold every published run, their analysis, figures and report replace the published ones. Else these
    gain the rows of the analysis that they lack, and the figures of the analysis are drawn anew. Weights, animations,
    documents, costs and results of verification stay. The replacement of the directory is atomic.

    Args:
        outputs: the outputs directory of one scale, named after the scale or after the property that its runs share; it
            may have an analysis of published runs alone, such as a test of generalization.
        results: reproduce/results.
        force: whether to publish runs of uncommitted code or other settings, and to replace all published runs by runs
            of another size or on other recordings.

    Returns:
        the published directory.

    Raises:
        InputError: no network is evaluated or published, a run is damaged, or without force there are doubts.
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
        found = _indexed(read_results(outputs))
        origins = {str(key.path): outputs.run(key).provenance() for key in keys_of(found)}
        published, stored = _read_published(target)
        has_network = any((rows["encoding"] != "").any() for rows in (found, published))
        if not has_network or not (len(found) or outputs.analysis.is_dir()):
            raise InputError(f"nothing to publish in {outputs.path}: no network is evaluated")
        kept = published.drop(found.index, errors="ignore")
        doubts = list(_differences(found, published, origins, {path: stored[path] for path in kept.index}))
        kept = kept.iloc[:0] if doubts else kept
        rows = pd.concat([part for part in (kept, found) if len(part)]).sort_values(KEY)
        origins = {path: stored[path] for path in kept.index} | origins
        doubts += _doubts(rows, {path: origins[path] for path in found.index})
        if doubts and not force:
            raise InputError(f"not published to {target}: {'; '.join(doubts)}; publish.force=true publishes it anyway")
        with replacing_directory(target) as new:
            if target.is_dir():
                shutil.copytree(target, new, dirs_exist_ok=True)
            if len(kept):
                _add_analysis(outputs.analysis, new / "analysis")
            else:
                _replace_files(outputs, new)
            counts = {name: "Int64" for name in ("train_pairs", "epochs") if name in rows}  # missing for baselines
            write_text(new / "runs.csv", rows.astype(counts).to_csv(index=False, float_format="%.6g"))
            content = {path: dataclasses.asdict(origin) for path, origin in origins.items()}
            write_json(new / "provenance.json", content)
            write_text(new / "README.md", published_page(new, name, rows))
    return target


def _indexed(rows: pd.DataFrame) -> pd.DataFrame:
    """Return runs with the paths of their directories as index."""
    rows = rows if len(rows) else pd.DataFrame(columns=KEY)
    return rows.set_index(pd.Index([str(key.path) for key in keys_of(rows)], dtype=object))


def _read_published(directory: Path) -> tuple[pd.DataFrame, Origins]:
    """Read the published runs of a directory with their provenance; none if nothing is published there."""
    if not (directory / "runs.csv").is_file():
        return _indexed(pd.DataFrame()), {}
    rows = read_published(directory)
    return _indexed(rows), read_origins(directory, keys_of(rows))


def _differences(found: pd.DataFrame, published: pd.DataFrame, origins: Origins, kept: Origins) -> Iterator[str]:
    """Yield why runs cannot stand beside the published ones, which they replace with force."""
    for fact, words in SIZES.items() if len(found) and len(published) else ():
        now, then = (sorted(set(rows[fact].dropna().convert_dtypes())) for rows in (found, published))
        if not set(now) <= set(then):
            had, have = (", ".join(map(str, values)) for values in (then, now))
            yield f"the published runs have {had} {words}, these runs {have}"
    for path, origin in origins.items():
        experiment = RunKey.parse(path).experiment
        others = recordings_of(kept, experiment)
        if others and origin.fact("recordings") not in others:
            yield f"{path} has other recordings than the published runs of experiment {experiment}"


def _doubts(rows: pd.DataFrame, origins: Origins) -> Iterator[str]:
    """Yield reasons against publishing the runs of `origins`; the rows hold them and those that are kept."""
    if any(str(step.get("commit", "")).endswith("+") for origin in origins.values() for step in origin.steps):
        yield "some runs were made with uncommitted code"
    for kind, alike in rows.groupby([_trained_alike(key) for key in keys_of(rows)]):
        listing = conflicts(alike)
        if listing and not set(alike.index).isdisjoint(origins):
            yield f"{kind} was trained with different settings: {listing}"


def _trained_alike(key: RunKey) -> str:
    """Name the runs that must share all settings with a run: those of the paper's method, or its other seeds."""
    is_papers = key.model in NETWORKS and key.encoding in (PROJECTION, PROJECTION_NO_DECAY)
    return "the paper's method" if is_papers else str(key.path.parent)


def _replace_files(outputs: Outputs, directory: Path) -> None:
    """Replace analysis, figures and report of a published directory by those of the outputs."""
    for path in directory.iterdir():
        is_kept = path.stem in ("costs", "verification", "tables") or path.suffix == ".gif"
        if path.is_file() and not is_kept:
            path.unlink()
    for path in (directory / "analysis").glob("*"):
        if path.suffix != ".gif":
            path.unlink()
    for path in (*outputs.figures.glob("*.png"), *outputs.path.glob("report.html")):
        shutil.copyfile(path, directory / path.name)
    if outputs.analysis.is_dir():
        passed_over = shutil.ignore_patterns("*.pdf", "*.tmp", "*.lock", ".*")
        shutil.copytree(outputs.analysis, directory / "analysis", ignore=passed_over, dirs_exist_ok=True)


def _add_analysis(source: Path, target: Path) -> None:
    """Add to the published tables of the analysis the rows of what they lack, and draw its figures anew."""
    if not (source.is_dir() and target.is_dir()):
        return
    for path in sorted(source.glob("*.csv")):
        rows = read_rows(path)
        if {"model", "encoding"} <= set(rows):  # else it follows from other tables
            earlier = read_rows(target / path.name) if (target / path.name).is_file() else rows.iloc[:0]
            columns = [name for name in IDENTIFYING if name in rows and name in earlier]
            new, present = (pd.MultiIndex.from_frame(table[columns].astype(str)) for table in (rows, earlier))
            table = pd.concat([earlier, rows[~new.isin(present)]])
            write_text(target / path.name, table.to_csv(index=False, float_format="%.6g"))
    names = [path.stem for path in target.glob("*.png")]
    write_analysis_figures(target, {path.stem: read_rows(path) for path in target.glob("*.csv")}, names, ("png",))


def published_page(directory: Path, name: str, runs: pd.DataFrame) -> str:
    """Return the README.md of a published directory."""
    analysis = " `analysis/` and `report.html` have the analysis." if (directory / "report.html").is_file() else ""
    return f"""# Published results, {name}

{caption(runs)}

`runs.csv` has every run with its seed, all metrics and times, `provenance.json` the command of every training, and the
commit, hardware and versions of every step.{analysis}
"""
