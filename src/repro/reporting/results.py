"""Run directories to tidy rows, and tidy rows to the paper's two tables with the difference to it."""

from pathlib import Path
from typing import Any

import pandas as pd

from repro.config import NETWORKS
from repro.evaluation.metrics import METRICS
from repro.evaluation.predictions import read_metrics
from repro.evaluation.rivals import RIVALS
from repro.provenance import Status
from repro.reporting.audit import audit
from repro.reporting.paper import KEYS, read_paper
from repro.runs import Outputs, Run

RUN_KEYS = ("experiment", "model", "encoding", "decay", "seed")  # what tells one run from another
SIZES = {"size_px": "px", "train_pairs": "training pairs", "test_pairs": "test pairs"}  # of runs, in words
OURS = ("unet", "stack10")  # the input that has come out best, see DEVIATIONS D17
ORDER = (*NETWORKS, "average", "ours", *RIVALS)  # of the rows of a table
FACTS = ("train_pairs", "test_pairs", "epochs", "training_seconds")


def read_results(outputs: Outputs, faults: list[str] | None = None) -> pd.DataFrame:
    """Reads every evaluated run below an outputs directory, one row each.

    Args:
        outputs: the outputs directory.
        faults: takes the message of every run that cannot be trusted, which is then left out; without it, the first
            such run is an error.

    Returns:
        experiment, model, encoding, decay, seed, all metrics, and what the run was: scale, size_px, train_pairs,
        test_pairs, epochs, training_seconds. Empty when there is none.

    Raises:
        ValueError: a run cannot be trusted and `faults` is not given, or the runs are of different resolutions or
            numbers of pairs, so no table can hold them.
    """
    rows = []
    for run in outputs.runs():
        try:
            if run.status is Status.evaluated:
                rows.append(_row(outputs, run))
        except ValueError as error:
            if faults is None:
                raise
            faults.append(str(error))
    table = pd.DataFrame(rows)
    for fact in ("scale", "size_px", "train_pairs", "test_pairs"):
        values = sorted(table[fact].dropna().unique().tolist()) if len(table) else []
        if len(values) > 1:
            raise ValueError(f"the runs in {outputs.path} differ in {fact}: {values}; one table cannot hold them")
    return table


def read_published(directory: Path) -> pd.DataFrame:
    """Reads the runs.csv of a published directory, rows as of `read_results`; the earliest name no encoding.

    Raises:
        ValueError: nothing is published there.
    """
    if not (directory / "runs.csv").is_file():
        raise ValueError(f"nothing is published in {directory}")
    runs = pd.read_csv(directory / "runs.csv", dtype={"experiment": str})
    return runs if "encoding" in runs else runs.assign(encoding="projection")


def _row(outputs: Outputs, run: Run) -> dict[str, Any]:
    config, origin = run.config(), run.provenance()
    place = outputs.run(config.experiment, config.model.name, config.encoding.variant, config.seed)
    if place != run:
        raise ValueError(f"{run} holds the run that belongs in {place}, by its config.yaml: move it there or delete it")
    return {
        "experiment": config.experiment,
        "model": config.model.name,
        "encoding": config.encoding.name,
        "decay": config.encoding.decay,
        "seed": config.seed,
        **{str(name): value for name, value in read_metrics(run).items()},
        "scale": config.data.scale,
        "size_px": config.data.size_px,
        **{name: origin.fact(name) for name in FACTS},
    }


def compare(results: pd.DataFrame, *, decay: bool) -> pd.DataFrame:
    """Makes the main table (`decay=True`) or the ablation: our metrics, the paper's, and the difference.

    Args:
        results: tidy rows, see `read_results`; those of the paper's projection are taken, and of `OURS`.
        decay: which of the two.

    Returns:
        experiment, model, decay, seeds, then every metric as <metric>, paper_<metric>, delta_<metric>, and
        std_<metric> where there are several seeds. The row `average` is the mean of the four networks, there
        when all four are. `ours` and simple predictors come last, with nothing of the paper beside them.
    """
    results = results[results["decay"] == decay]
    of_paper = results[(results["encoding"] == "projection") & results["model"].isin([*NETWORKS, *RIVALS])]
    ours = results[(results["model"] == OURS[0]) & (results["encoding"] == OURS[1])].assign(model="ours")
    rows = pd.concat([of_paper, averages_of(of_paper), ours])
    groups = rows.groupby(KEYS)
    table = groups[list(METRICS)].mean().join(groups.size().rename("seeds")).reset_index()
    several = table["seeds"].max() > 1
    spread = groups[list(METRICS)].std().reset_index()
    table = table.merge(read_paper(), on=KEYS, how="left", suffixes=("", "_paper"))
    columns = {"experiment": table["experiment"], "model": table["model"], "decay": table["decay"]}
    columns["seeds"] = table["seeds"]
    for metric in METRICS:
        columns[metric] = table[metric]
        columns[f"paper_{metric}"] = table[f"{metric}_paper"]
        columns[f"delta_{metric}"] = table[metric] - table[f"{metric}_paper"]
        if several:
            columns[f"std_{metric}"] = spread[metric]
    order = table["model"].map({name: rank for rank, name in enumerate(ORDER)})
    return pd.DataFrame(columns).assign(order=order).sort_values(["experiment", "order"]).drop(columns="order")


def averages_of(results: pd.DataFrame) -> pd.DataFrame:
    """Makes the rows `average`, the mean of the four networks, of each seed that has them all."""
    keys = [key for key in ("experiment", "decay", "seed") if key in results]
    networks = results[results["model"].isin(NETWORKS)]
    complete = networks.groupby(keys).filter(lambda rows: len(rows) == len(NETWORKS))
    return complete.groupby(keys, as_index=False)[list(METRICS)].mean().assign(model="average")


def audits(results: pd.DataFrame) -> pd.DataFrame:
    """Audits the paper's tables and ours, see `audit.audit`; `whose` tells them apart."""
    rows = results[(results["encoding"] == "projection") & results["model"].isin(NETWORKS)]
    ours = rows.groupby(KEYS, as_index=False)[list(METRICS)].mean()
    tables = {"paper": read_paper(), "ours": pd.concat([ours, averages_of(ours)])}
    return pd.concat([audit(table[[*KEYS, *METRICS]]).assign(whose=whose) for whose, table in tables.items()])


def caption(results: pd.DataFrame) -> str:
    """Says what a table is made from: scale, resolution, pairs, epochs and seeds."""
    networks = results[results["model"].isin(NETWORKS)]
    if networks.empty:
        return "No network evaluated yet."
    of_paper = networks[networks["encoding"] == "projection"]
    networks = of_paper if len(of_paper) else networks
    first = networks.iloc[0]
    seeds = sorted(networks["seed"].unique())
    cells = networks.groupby(["experiment", "model", "decay"]).size()
    uneven = f", {cells.min()} to {cells.max()} a cell" if cells.min() < cells.max() else ""
    epochs = " to ".join(f"{count:.0f}" for count in sorted({networks["epochs"].min(), networks["epochs"].max()}))
    warning = " A test that every part works; its numbers mean nothing." if first["scale"] == "smoke" else ""
    return (
        f"Scale {first['scale']}: {first['size_px']} x {first['size_px']} px, {int(first['train_pairs'])} training and "
        f"{int(first['test_pairs'])} test pairs an experiment, {epochs} epochs, "
        f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}{uneven}.{warning}"
    )
