"""Publishing: the results of an outputs directory replace those of the directory of its name in reproduce/results.

A published directory contains runs.csv (every run with its seed, metrics and times), from which all tables follow,
provenance.json (the provenance of every run), the analysis, the figures, and a README.md. The generated tables of the
documents come from published directories only, and so does the page, see `page.render_published`.
"""

import dataclasses
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from repro.reporting.results import conflicts, keys_of, read_origins, read_published, read_results
from repro.reporting.tables import caption
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.keys import KEY, RunKey
from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, replacing_directory, write_json, write_text

SIZES = {"size_px": "px", "train_pairs": "training pairs", "test_pairs": "test pairs", "scale": "as scale"}
OTHERS = ("costs", "verification", "tables")  # stems of files that other commands write, or a person
Origins = dict[str, Provenance]  # by the path of the run


def publish(outputs: Outputs, results: Path, *, force: bool = False) -> Path:
    """Publish the runs, the analysis and the figures of an outputs directory in place of what is published.

    Weights, animations, documents, costs and results of verification stay. The replacement of the directory is atomic.

    Args:
        outputs: the outputs directory of one scale, named after the scale or after the property that its runs share.
        results: reproduce/results.
        force: whether to publish in spite of doubts: the outputs lack published runs or have another size, or runs are
            of uncommitted code or were trained with different settings.

    Returns:
        the published directory.

    Raises:
        InputError: no network is evaluated, a run is damaged, or without force there are doubts.
    """
    name = outputs.path.name
    if not re.fullmatch(r"[\w-]+", name):
        raise InputError(
            f"outputs={outputs.path}: results are published under its last part, which must be a plain name"
        )
    target = results / name
    results.mkdir(parents=True, exist_ok=True)
    with lock(results):
        clear_leftovers(results)
        rows = read_results(outputs)
        if rows.empty or not (rows["encoding"] != "").any():
            raise InputError(f"nothing to publish in {outputs.path}: no network is evaluated")
        rows = rows.sort_values(KEY)
        origins = {str(key.path): outputs.run(key).provenance() for key in keys_of(rows)}
        doubts = [*_losses(target, rows, origins), *_doubts(rows, origins)]
        if doubts and not force:
            raise InputError(f"not published to {target}: {'; '.join(doubts)}; publish.force=true publishes it anyway")
        with replacing_directory(target) as new:
            _keep_others(target, new)
            _copy_files(outputs, new)
            counts = {name: "Int64" for name in ("train_pairs", "epochs") if name in rows}  # missing for baselines
            write_text(new / "runs.csv", rows.astype(counts).to_csv(index=False, float_format="%.6g"))
            write_json(new / "provenance.json", {path: dataclasses.asdict(item) for path, item in origins.items()})
            write_text(new / "README.md", published_page(new, name, rows))
    return target


def _losses(target: Path, rows: pd.DataFrame, origins: Origins) -> Iterator[str]:
    """Yield what is published and would be gone: runs, or results of another size."""
    if not (target / "runs.csv").is_file():
        return
    published = read_published(target)
    for fact, words in SIZES.items():
        now, then = (sorted(set(table[fact].dropna().convert_dtypes())) for table in (rows, published))
        if not set(now) <= set(then):
            had, have = (", ".join(map(str, values)) for values in (then, now))
            yield f"the published runs have {had} {words}, these runs {have}"
    if lost := sorted(set(read_origins(target)) - set(origins)):
        yield f"{len(lost)} published runs are not in the outputs, such as {lost[0]}"


def _doubts(rows: pd.DataFrame, origins: Origins) -> Iterator[str]:
    """Yield reasons against publishing runs, given the rows and the provenance of all."""
    if any(str(step.get("commit", "")).endswith("+") for origin in origins.values() for step in origin.steps):
        yield "some runs were made with uncommitted code"
    for kind, alike in rows.groupby([_trained_alike(key) for key in keys_of(rows)]):
        if listing := conflicts(alike):
            yield f"{kind} was trained with different settings: {listing}"


def _trained_alike(key: RunKey) -> str:
    """Name the runs that must share all settings with a run: those of the paper's method, or its other seeds."""
    is_papers = key.model in NETWORKS and key.encoding in (PROJECTION, PROJECTION_NO_DECAY)
    return "the paper's method" if is_papers else str(key.path.parent)


def _keep_others(published: Path, new: Path) -> None:
    """Copy to a new directory what publishing does not write: exported weights, animations, `OTHERS`."""
    for path in published.iterdir() if published.is_dir() else ():
        if path.is_dir():
            passed_over = shutil.ignore_patterns("*.csv", "*.json", "*.png") if path.name == "analysis" else None
            shutil.copytree(path, new / path.name, ignore=passed_over)
        elif path.stem in OTHERS or path.suffix == ".gif":
            shutil.copyfile(path, new / path.name)


def _copy_files(outputs: Outputs, directory: Path) -> None:
    """Copy the figures, and the tables and figures of the analysis."""
    for path in outputs.figures.glob("*.png"):
        shutil.copyfile(path, directory / path.name)
    if outputs.analysis.is_dir():
        passed_over = shutil.ignore_patterns("*.pdf", "*.tmp", "*.lock", ".*")
        shutil.copytree(outputs.analysis, directory / "analysis", ignore=passed_over, dirs_exist_ok=True)


def published_page(directory: Path, name: str, runs: pd.DataFrame) -> str:
    """Return the README.md of a published directory."""
    has_analysis = (directory / "analysis" / "intervals.csv").is_file()
    analysis = f"""

`analysis/` has the analysis. `python -m repro.reporting.page reproduce/results/{name} {name}.html` makes a page of all
tables and figures."""
    return f"""# Published results, {name}

{caption(runs)}

`runs.csv` has every run with its seed, all metrics and times, `provenance.json` the command of every training, and the
commit, hardware and versions of every step.{analysis if has_analysis else ""}
"""
