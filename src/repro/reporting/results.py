"""Run directories to tidy rows, and tidy rows to the paper's two tables with the difference to it."""

from pathlib import Path
from typing import Any

import pandas as pd

from repro.evaluation.metrics import METRICS
from repro.reporting.paper import KEYS, read_paper
from repro.runs import read_config, read_provenance, read_status

MODELS = ("unet", "fpn", "upernet", "segformer", "average", "all_free", "last_seen")  # order of the rows
TRAINED = MODELS[:4]


def read_results(outputs: Path) -> pd.DataFrame:
    """Reads every evaluated run below an outputs directory, one row each.

    Returns:
        experiment, model, decay, seed, all metrics, and what the run was: size_px, train_pairs, test_pairs,
        epochs, training_seconds. Empty when there is none.

    Raises:
        ValueError: the runs are of different resolutions or numbers of pairs, so no table can hold them.
    """
    rows: list[dict[str, Any]] = []
    for path in sorted(outputs.glob("runs/exp*/*/*/seed*/metrics.csv")):
        config, origin = read_config(path.parent), read_provenance(path.parent)
        if read_status(path.parent) != "evaluated":
            continue
        facts = {name: origin.get(name) for name in ("train_pairs", "test_pairs", "epochs", "training_seconds")}
        rows.append(
            {
                "experiment": str(config["experiment"]),
                "model": config["model"]["name"],
                "decay": config["decay"],
                "seed": config["seed"],
                **{str(name): value for name, value in pd.read_csv(path).iloc[0].items()},
                "size_px": config["data"]["size_px"],
                **facts,
            }
        )
    table = pd.DataFrame(rows)
    for fact in ("size_px", "train_pairs", "test_pairs"):
        values = sorted(table[fact].dropna().unique().tolist()) if len(table) else []
        if len(values) > 1:
            raise ValueError(f"the runs in {outputs} differ in {fact}: {values}; one table cannot hold them")
    return table


def compare(results: pd.DataFrame, *, decay: bool) -> pd.DataFrame:
    """The main table (`decay=True`) or the ablation: our metrics, the paper's, and the difference.

    Returns:
        experiment, model, decay, seeds, then every metric as <metric>, paper_<metric>, delta_<metric>, and
        std_<metric> where there are several seeds. The row `average` is the mean of the four networks, there
        when all four are. Simple predictors come last, with nothing of the paper beside them.
    """
    results = results[results["decay"] == decay]
    networks = results[results["model"].isin(TRAINED)]
    complete = networks.groupby(["experiment", "seed"]).filter(lambda rows: len(rows) == len(TRAINED))
    averages = complete.groupby(["experiment", "decay", "seed"], as_index=False)[list(METRICS)].mean()
    rows = pd.concat([results, averages.assign(model="average")])
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
    order = table["model"].map({name: rank for rank, name in enumerate(MODELS)})
    return pd.DataFrame(columns).assign(order=order).sort_values(["experiment", "order"]).drop(columns="order")


def caption(results: pd.DataFrame, scale: str) -> str:
    """What a table is made from: scale, resolution, pairs, epochs and seeds."""
    networks = results[results["model"].isin(TRAINED)]
    if networks.empty:
        return f"Scale {scale}: no network evaluated yet."
    first, seeds = networks.iloc[0], sorted(networks["seed"].unique())
    epochs = " to ".join(f"{count:.0f}" for count in sorted({networks["epochs"].min(), networks["epochs"].max()}))
    return (
        f"Scale {scale}: {first['size_px']} x {first['size_px']} px, {int(first['train_pairs'])} training and "
        f"{int(first['test_pairs'])} test pairs an experiment, {epochs} epochs, "
        f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}."
    )
