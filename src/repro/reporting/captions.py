"""What the captions of tables state: data, seeds, networks that are missing or were trained with other settings."""

import pandas as pd

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.networks.model import NETWORKS
from repro.reporting.names import model_title
from repro.reporting.paper import read_paper
from repro.reporting.rows import Settings, changed, read_cells, usual
from repro.runs.keys import CELL


def caption(results: pd.DataFrame) -> str:
    """Return the data of a table as one sentence: scale, resolution, pairs, epochs and seeds."""
    networks = results[results["encoding"] != ""]
    if networks.empty:
        return "No network evaluated yet."
    of_paper = networks[networks["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])]
    networks = of_paper if len(of_paper) else networks
    first = networks.iloc[0]
    seeds = sorted(networks["seed"].unique())
    cells = networks.groupby(CELL).size()
    uneven = f" ({cells.min()} to {cells.max()} per cell)" if cells.min() < cells.max() else ""
    epochs = " to ".join(f"{count:.0f}" for count in sorted({networks["epochs"].min(), networks["epochs"].max()}))
    warning = " This is a smoke test; its numbers mean nothing." if first["scale"] == "smoke" else ""
    return (
        f"Scale {first['scale']}: {first['size_px']} x {first['size_px']} px, {int(first['train_pairs'])} training and "
        f"{int(first['test_pairs'])} test pairs per experiment, {epochs} epochs, "
        f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}{uneven}.{warning}{_unlike(networks)}"
    )


def missing(results: pd.DataFrame, encoding: str) -> str:
    """Name the cells of a table of the paper that have no run; empty if it has none of the paper's or all of them.

    Args:
        results: tidy rows of the table, see `select`.
        encoding: label of the encoding of the table.
    """
    paper = read_paper()
    wanted = paper[(paper["encoding"] == encoding) & paper["model"].isin(NETWORKS)]
    found = set(zip(results["experiment"], results["model"], results["encoding"], strict=True))
    lacking = wanted[[cell not in found for cell in wanted[CELL].itertuples(index=False, name=None)]]
    if len(lacking) in (0, len(wanted)):
        return ""
    names: dict[str, list[str]] = {}  # networks by the experiments that they lack
    for model in NETWORKS:
        experiments = sorted(lacking.loc[lacking["model"] == model, "experiment"])
        in_all = len(experiments) == wanted["experiment"].nunique()
        where = "" if in_all else f" in exp {', '.join(experiments)}"
        if experiments:
            names.setdefault(where, []).append(model_title(model))
    parts = [", ".join(models) + where for where, models in names.items()]
    return f" Not trained: {'; '.join(parts)}."


def _comparable(settings: Settings) -> Settings:
    """Return the settings without those of the model if it is a network of our own, which no other network has."""
    if settings.get("model.encoder_name"):
        return settings
    return {key: value for key, value in settings.items() if not key.startswith("model.")}


def _unlike(networks: pd.DataFrame) -> str:
    """Name the networks of a table that were trained with other settings than most."""
    if "settings" not in networks:  # all were published before the column existed
        return ""
    settings = [_comparable(each) for each in read_cells(networks["settings"])]
    reference = usual(settings)
    texts = [", ".join(f"{key}={value}" for key, value in changed(each, reference).items()) for each in settings]
    groups = networks.assign(changed=texts).query("changed != ''").groupby(["changed", "model"])
    unlike = [
        f"{model_title(str(model))} in exp {', '.join(sorted(rows['experiment'].unique()))} ({text})"
        for (text, model), rows in groups
    ]
    return f" Not trained like the others: {'; '.join(unlike)}." if unlike else ""
