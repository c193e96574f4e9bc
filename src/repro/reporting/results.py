"""Tidy rows of all evaluated runs, and the paper's two tables from them with the differences to the paper."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from repro.baselines.names import OTHER_BOUNDS, QUICK_BASELINES, rank
from repro.config import NO_DECAY, PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import EXTRA_METRICS, METRICS, TABLE_METRICS
from repro.networks.model import NETWORKS
from repro.reporting.paper import are_papers, audit, read_paper
from repro.reporting.rows import MEASURED, conflicts, keys_of, read_rows, settings_cell
from repro.runs.directories import Run
from repro.runs.keys import CELL, KEY, RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance, Status
from repro.system.errors import InputError
from repro.system.files import read_typed

SIZES = {
    "size_px": "px",
    "train_pairs": "training pairs",
    "test_pairs": "test pairs",
}  # sizes of a run with their units
OURS = ("convgru", "series10")  # our best network and input: DEVIATIONS D17, D22
STUDIED = (*NETWORKS, "convgru", "convlstm")  # the networks of this study
FACTS = ("train_pairs", "test_pairs", "epochs", "training_seconds")


def read_results(outputs: Outputs, errors: list[str] | None = None) -> pd.DataFrame:
    """Read every evaluated run below an outputs directory, one row each.

    Args:
        outputs: the outputs directory.
        errors: receives the message of every damaged run, which is then left out; None raises at the first damaged run.

    Returns:
        experiment, model, encoding, seed, all metrics, and scale, size_px, train_pairs, test_pairs, epochs,
        training_seconds, papers_worlds, whether the worlds are those of conf/world/paper.yaml, and settings, see
        `reporting.rows`. Empty if no run is evaluated.

    Raises:
        ValueError: a run is damaged and `errors` is None, or the runs have different resolutions or numbers of pairs,
            or seeds of one network different settings, and cannot share a table.
    """
    rows = []
    for run in outputs.runs():
        try:
            if run.status is Status.evaluated:
                rows.append(_row(outputs, run))
        except InputError as error:
            if errors is None:
                raise
            errors.append(str(error))
    table = pd.DataFrame(rows)
    if len(table):
        table = _with_all_metrics(table)
        table["seed"] = table["seed"].astype("Int64")  # baselines have no seed
        _check_comparable(outputs, table)
    return table.drop(columns="worlds", errors="ignore")


def _check_comparable(outputs: Outputs, table: pd.DataFrame) -> None:
    """Check that runs can share a table: one scale, resolution and number of pairs, and one world per experiment.

    The seeds of a network must have the same settings.
    """
    groups = [(fact, table) for fact in ("scale", "size_px", "train_pairs", "test_pairs")]
    groups += [("worlds", rows) for _, rows in table.groupby("experiment")]
    for fact, rows in groups:
        counts = rows[fact].value_counts()
        if len(counts) > 1:
            rare = rows[rows[fact] == counts.index[-1]]
            paths = ", ".join(str(outputs.path / key.path) for key in keys_of(rare)[:3])
            raise InputError(
                f"the runs in {outputs.path} differ in {fact} ({', '.join(sorted(map(str, counts.index)))}) and cannot "
                f"share a table: move or delete {paths}" + (f" and {len(rare) - 3} more" if len(rare) > 3 else "")
            )
    for _, rows in table.groupby(CELL):
        listing = conflicts(rows["settings"])
        if listing:
            paths = ", ".join(str(outputs.path / key.path) for key in keys_of(rows))
            raise InputError(f"seeds of one network have different settings ({listing}): move or delete one of {paths}")


def read_published(directory: Path) -> pd.DataFrame:
    """Load the runs.csv of a published directory, with the columns of `read_results`.

    Raises:
        ValueError: the directory has no runs.csv, or it cannot be read, or it has a run twice or without its metrics.
    """
    path = directory / "runs.csv"
    if not path.is_file():
        published = sorted(path.parent.name for path in directory.parent.glob("*/runs.csv"))
        raise InputError(
            f"no results are published in {directory}; published results: {', '.join(published) or 'none'}"
        )
    rows = read_rows(path, (*KEY, *MEASURED, "scale", "size_px", *FACTS))
    wrong = [name for name in MEASURED if not pd.to_numeric(rows[name], errors="coerce").between(-1, 1).all()]
    if wrong or rows.empty or rows.duplicated(KEY).any():
        expected = f"one row per run, with {', '.join(wrong or MEASURED)} from -1 to 1"
        raise InputError(f"{path} cannot be read (expected {expected}): restore it from git")
    return _with_all_metrics(rows)


def read_frames(directory: Path) -> dict[str, pd.DataFrame]:
    """Load the tables of the analysis of a published directory, and `costs`, by their names."""
    return {path.stem: read_rows(path) for path in (*directory.glob("analysis/*.csv"), *directory.glob("costs.csv"))}


def _with_all_metrics(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the columns of metrics that are younger than the evaluation of all runs, without values."""
    return rows.reindex(columns=list(dict.fromkeys([*rows.columns, *EXTRA_METRICS])))


def read_origins(directory: Path, keys: Iterable[RunKey] = ()) -> dict[str, Provenance]:
    """Load the provenance of the runs of a published directory, by their paths.

    Args:
        directory: the published directory.
        keys: the runs that must have an entry.

    Raises:
        ValueError: provenance.json cannot be read, lacks one of the runs, or has a run without steps.
    """
    path, fix = directory / "provenance.json", "restore it from git"
    origins = read_typed(dict[str, Provenance], path, fix)
    for name, origin in origins.items():
        try:
            RunKey.parse(name)
        except InputError as error:
            raise InputError(f"{path} cannot be read ({error}): {fix}") from error
        if not origin.steps or not all("step" in step for step in origin.steps):
            raise InputError(f"{path} cannot be read ({name}: expected steps with names, got {origin.steps}): {fix}")
    missing = [str(key.path) for key in keys if str(key.path) not in origins]
    if missing:
        raise InputError(f"{path} cannot be read (it lacks {len(missing)} runs of runs.csv, {missing[0]} first): {fix}")
    return origins


def recordings_of(origins: dict[str, Provenance], experiment: str) -> set[object]:
    """Return the checksums of the recordings of the runs of an experiment."""
    of_experiment = (origin for path, origin in origins.items() if RunKey.parse(path).experiment == experiment)
    return {origin.fact("recordings") for origin in of_experiment}


def _row(outputs: Outputs, run: Run) -> dict[str, Any]:
    config, origin = run.config(), run.provenance()
    expected = outputs.run(config.key)
    if expected != run:
        raise InputError(f"{run} holds the run of {expected}, by its config.yaml: move it there or delete it")
    return {
        **dict(zip(KEY, (config.key.experiment, config.key.model, config.key.encoding, config.key.seed), strict=True)),
        **{str(name): value for name, value in run.read_metrics().items()},
        "scale": config.data.scale,
        "worlds": config.data.worlds,
        "papers_worlds": are_papers(config.data.worlds),
        "size_px": config.data.size_px,
        **{name: origin.fact(name) for name in FACTS},
        "settings": settings_cell(config),
    }


def compare(results: pd.DataFrame, encoding: str) -> pd.DataFrame:
    """Create the main table (the paper's projection) or the ablation (the projection without decay).

    Args:
        results: tidy rows, see `read_results`.
        encoding: label of the encoding; for other rows of the table see `select`.

    Returns:
        experiment, model, encoding, seeds, then every metric as <metric>, paper_<metric>, delta_<metric>, and
        std_<metric> if there are several seeds. The row `average` is the mean of the paper's four networks, present if
        all four are evaluated. Other models and baselines follow, without the paper's numbers.
    """
    rows = select(results, encoding)
    rows = pd.concat([rows, averages_of(rows[rows["encoding"] == encoding])])
    groups = rows.groupby(CELL)
    table = groups[list(TABLE_METRICS)].mean().join(groups.size().rename("seeds")).reset_index()
    spread = groups[list(TABLE_METRICS)].std().reset_index()
    table = table.merge(of_papers_worlds(read_paper(), rows), on=CELL, how="left", suffixes=("", "_paper"))
    columns = {name: table[name] for name in (*CELL, "seeds")}
    for metric in TABLE_METRICS:
        columns[metric] = table[metric]
        columns[f"paper_{metric}"] = table[f"{metric}_paper"] if metric in METRICS else float("nan") * table[metric]
        columns[f"delta_{metric}"] = table[metric] - columns[f"paper_{metric}"]
        if table["seeds"].max() > 1:
            columns[f"std_{metric}"] = spread[metric]
    order = table["model"].map(rank)
    return pd.DataFrame(columns).assign(order=order).sort_values(["experiment", "order"]).drop(columns="order")


def of_papers_worlds(rows: pd.DataFrame, results: pd.DataFrame) -> pd.DataFrame:
    """Return the rows without the experiments whose runs, see `read_results`, have other worlds than the paper's."""
    if "papers_worlds" not in results:  # all were published before the column existed
        return rows
    return rows[~rows["experiment"].isin(results.loc[results["papers_worlds"].eq(False), "experiment"])]


def select(results: pd.DataFrame, encoding: str) -> pd.DataFrame:
    """Select the runs of a table: one encoding and the quick baselines.

    The main table has all baselines, `OURS`, and the networks of the user, which are not in `STUDIED`, with any input.
    """
    chosen = results["encoding"] == encoding
    if encoding == PROJECTION:
        is_ours = (results["model"] == OURS[0]) & (results["encoding"] == OURS[1])
        is_users = (
            (results["encoding"] != "") & ~results["model"].isin(STUDIED) & ~results["encoding"].str.endswith(NO_DECAY)
        )
        is_baseline = (results["encoding"] == "") & ~results["model"].isin(list(OTHER_BOUNDS))
        chosen |= is_ours | is_users | is_baseline
    elif chosen.any():
        is_there = results["experiment"].isin(results.loc[chosen, "experiment"])
        chosen |= is_there & results["model"].isin(QUICK_BASELINES)
    return results[chosen]


def averages_of(results: pd.DataFrame) -> pd.DataFrame:
    """Compute the rows `average`, the mean of the paper's four networks, for each seed with all four."""
    keys = [key for key in ("experiment", "encoding", "seed") if key in results]
    networks = results[results["model"].isin(NETWORKS)]
    complete = networks.groupby(keys).filter(lambda rows: len(rows) == len(NETWORKS))
    return complete.groupby(keys, as_index=False)[list(TABLE_METRICS)].mean().assign(model="average")


def audits(results: pd.DataFrame) -> pd.DataFrame:
    """Audit the paper's tables and ours, see `audit.audit`; the column `source` is `paper` or `ours`."""
    rows = results[results["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY]) & results["model"].isin(NETWORKS)]
    ours = pd.concat([rows, averages_of(rows)]).groupby(CELL, as_index=False)[list(TABLE_METRICS)].mean()
    tables = {"paper": of_papers_worlds(read_paper(), results), "ours": ours}
    return pd.concat([audit(table[[*CELL, *METRICS]]).assign(source=source) for source, table in tables.items()])
