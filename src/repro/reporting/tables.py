"""The paper's tables from tidy rows: a frame and a caption that states data, seeds, and which networks are missing."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from repro.baselines.titles import QUICK_BASELINES, rank
from repro.metrics.headings import HEADINGS, TABLE_METRICS
from repro.reporting.names import model_title, predictor_title
from repro.reporting.paper import read_paper
from repro.reporting.render import Cells, number
from repro.reporting.results import of_papers_worlds, settings_of
from repro.runs.config import NO_DECAY, PROJECTION, PROJECTION_NO_DECAY
from repro.runs.keys import CELL
from repro.runs.model import NETWORKS
from repro.system.files import write_text

OURS = ("convgru", "series10")  # our best network and input: DEVIATIONS D17, D22
STUDIED = (*NETWORKS, "convgru", "convlstm")  # the networks of this study
TABLES = {  # titles, and encoding of the networks
    "main": ("Prediction metrics", PROJECTION),
    "ablation": ("Prediction metrics without the gray-scale time decay", PROJECTION_NO_DECAY),
}


@dataclass(frozen=True)
class Table:
    """Rows with named columns, see `compare_with_paper`, and their caption; empty if no run is evaluated."""

    frame: pd.DataFrame
    caption: str

    @property
    def cells(self) -> Cells:
        """One row per model: our number, and the paper's in brackets, which has none for other worlds."""
        rows = [
            (row["experiment"], row_title(row), *(_compared(row, metric) for metric in TABLE_METRICS))
            for _, row in self.frame.iterrows()
        ]
        has_paper = self.frame.filter(like="paper_").notna().any(axis=None)
        heads = ("Exp.", "Model", *(HEADINGS.get(metric, metric) for metric in TABLE_METRICS))
        return Cells(heads, rows, self.caption, " Ours (paper)." if has_paper else "", text_columns=2)

    def to_markdown(self) -> str:
        """Return the table as Markdown."""
        return f"**{self.caption}**\n" if self.frame.empty else self.cells.to_markdown()

    def write(self, directory: Path, name: str) -> None:
        """Write <name>.csv and <name>.md to a directory, or delete those of an earlier table if it is empty."""
        texts = {"csv": self.frame.to_csv(index=False, float_format="%.4f"), "md": self.to_markdown()}
        for suffix, text in texts.items():
            path = directory / f"{name}.{suffix}"
            if self.frame.empty:
                path.unlink(missing_ok=True)
            else:
                write_text(path, text)


def _compared(row: pd.Series, metric: str) -> str:
    """Format one number with its deviation and the paper's; old results may lack a young metric."""
    ours, spread, paper = (number(row.get(f"{kind}{metric}")) for kind in ("", "std_", "paper_"))
    return ours + (f" ± {spread}" if spread else "") + (f" ({paper})" if paper else "")


def row_title(row: pd.Series) -> str:
    """Return the title of a row: its model, and its encoding unless it is that of the table."""
    mark = " (ours)" if (row["model"], row["encoding"]) == OURS else ""
    return predictor_title(row["model"], str(row["encoding"]).removesuffix(NO_DECAY)) + mark


def make_tables(results: pd.DataFrame) -> dict[str, Table]:
    """Create the main table and the ablation from tidy rows; a table without rows is empty."""
    tables = {}
    for name, (title, encoding) in TABLES.items():
        rows = select(results, encoding) if len(results) else results
        if rows.empty:
            tables[name] = Table(pd.DataFrame(), f"{title}. No run evaluated yet.")
        else:
            tables[name] = Table(
                compare_with_paper(results, encoding), f"{title}. {caption(rows)}{missing(rows, encoding)}"
            )
    return tables


def write_tables(directory: Path, results: pd.DataFrame) -> dict[str, Table]:
    """Write the main table and the ablation of all evaluated runs, see `results.read_results`, to a directory."""
    directory.mkdir(parents=True, exist_ok=True)
    tables = make_tables(results)
    for name, table in tables.items():
        table.write(directory, name)
    return tables


def not_shown(results: pd.DataFrame) -> str:
    """Name the evaluated networks and inputs that are in neither table; empty if none."""
    if results.empty:
        return ""
    shown = pd.concat([select(results, encoding) for _, encoding in TABLES.values()]).index
    others = results[(results["encoding"] != "") & ~results.index.isin(shown)]
    titles = dict.fromkeys(map(predictor_title, others["model"], others["encoding"]))
    return f"Evaluated, but in the tables of task=analysis only: {'; '.join(titles)}." if titles else ""


def compare_with_paper(results: pd.DataFrame, encoding: str) -> pd.DataFrame:
    """Create the main table (the paper's projection) or the ablation (the projection without decay).

    Args:
        results: tidy rows, see `read_results`.
        encoding: label of the encoding; for other rows of the table see `select`.

    Returns:
        experiment, model, encoding, seeds, then every metric as <metric>, paper_<metric>, delta_<metric>, and
        std_<metric> if there are several seeds. The row `average` is the mean of the paper's four networks, present if
        all four are evaluated. Other models and baselines follow, without the paper's numbers.
    """
    rows, metrics = select(results, encoding), list(TABLE_METRICS)
    groups = pd.concat([rows, averages_of(rows[rows["encoding"] == encoding])]).groupby(CELL)
    ours, seeds = groups[metrics].mean(), groups.size().rename("seeds")
    paper = of_papers_worlds(read_paper(), rows).set_index(CELL).reindex(ours.index, columns=metrics)
    parts = {"": ours, "paper_": paper, "delta_": ours - paper}
    if seeds.max() > 1:
        parts["std_"] = groups[metrics].std()
    table = pd.concat([seeds, *(part.add_prefix(prefix) for prefix, part in parts.items())], axis=1)
    table = table[["seeds", *(prefix + metric for metric in metrics for prefix in parts)]].reset_index()
    return table.sort_values(["experiment", "model"], key=lambda keys: keys.map(rank) if keys.name == "model" else keys)


def select(results: pd.DataFrame, encoding: str) -> pd.DataFrame:
    """Select the runs of a table: one encoding and the quick baselines.

    The main table has all baselines, `OURS`, and the networks of the user, which are not in `STUDIED`, with any input.
    """
    model, inputs = results["model"], results["encoding"]
    chosen = inputs == encoding
    if encoding == PROJECTION:
        chosen |= (model == OURS[0]) & (inputs == OURS[1])
        chosen |= (inputs != "") & ~model.isin(STUDIED) & ~inputs.str.endswith(NO_DECAY)
        chosen |= (inputs == "") & (model != "inference")
    else:
        is_there = results["experiment"].isin(results.loc[chosen, "experiment"])
        chosen |= is_there & model.isin(QUICK_BASELINES)
    return results[chosen]


def averages_of(results: pd.DataFrame) -> pd.DataFrame:
    """Compute the rows `average`, the mean of the paper's four networks, for each seed with all four."""
    keys = ["experiment", "encoding", "seed"]
    networks = results[results["model"].isin(NETWORKS)]
    complete = networks.groupby(keys).filter(lambda rows: len(rows) == len(NETWORKS))
    return complete.groupby(keys, as_index=False)[list(TABLE_METRICS)].mean().assign(model="average")


def caption(results: pd.DataFrame) -> str:
    """Return the data of a table as one sentence: scale, resolution, pairs, epochs and seeds.

    More sentences name experiments of other worlds than the paper's beside some of the paper's, and networks that were
    trained with other settings than most.
    """
    networks = results[results["encoding"] != ""]
    if networks.empty:
        return "No network evaluated yet."
    of_paper = networks[networks["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])]
    networks = of_paper if len(of_paper) else networks
    first, cells = networks.iloc[0], networks.groupby(CELL).size()
    seeds = sorted(networks["seed"].unique())
    uneven = f" ({cells.min()} to {cells.max()} per cell)" if cells.min() < cells.max() else ""
    epochs = " to ".join(f"{count:.0f}" for count in sorted({networks["epochs"].min(), networks["epochs"].max()}))
    text = (
        f"Scale {first['scale']}: {first['size_px']} x {first['size_px']} px, {int(first['train_pairs'])} training and "
        f"{int(first['test_pairs'])} test pairs per experiment, {epochs} {'epoch' if epochs == '1' else 'epochs'}, "
        f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}{uneven}."
    )
    is_other = networks["papers_worlds"].eq(False)
    if is_other.any() and not is_other.all():
        text += f" Not the paper's worlds: exp {', '.join(sorted(networks.loc[is_other, 'experiment'].unique()))}."
    unlike = _unlike(networks)
    return text + (f" Not trained like the others: {'; '.join(unlike)}." if unlike else "")


def _unlike(networks: pd.DataFrame) -> list[str]:
    """Name the networks of a table with other settings than most; only the paper's share those of the model."""
    settings = settings_of(networks)
    of_model = [name for name in settings if str(name).startswith("model.")]
    settings.loc[~networks["model"].isin(NETWORKS), of_model] = None
    usual = settings.mode().iloc[0] if settings.notna().any(axis=None) else pd.Series()
    changed = settings.where(settings.ne(usual))
    texts = [", ".join(f"{key}={value}" for key, value in row.dropna().items()) for _, row in changed.iterrows()]
    groups = networks.assign(changed=texts).query("changed != ''").groupby(["changed", "model"])["experiment"]
    return [
        f"{model_title(str(model))} in exp {', '.join(sorted(own.unique()))} ({text})" for (text, model), own in groups
    ]


def missing(results: pd.DataFrame, encoding: str) -> str:
    """Name the cells of a table of the paper that have no run; empty if it has none of the paper's or all of them.

    Args:
        results: tidy rows of the table, see `select`.
        encoding: label of the encoding of the table.
    """
    paper = read_paper()
    wanted = paper[(paper["encoding"] == encoding) & paper["model"].isin(NETWORKS)]
    lacking = wanted[~pd.MultiIndex.from_frame(wanted[CELL]).isin(pd.MultiIndex.from_frame(results[CELL]))]
    if len(lacking) in (0, len(wanted)):
        return ""
    names: dict[str, list[str]] = {}  # networks by the experiments that they lack
    for model in NETWORKS:
        experiments = sorted(lacking.loc[lacking["model"] == model, "experiment"])
        where = f" in exp {', '.join(experiments)}" if len(experiments) < wanted["experiment"].nunique() else ""
        if experiments:
            names.setdefault(where, []).append(model_title(model))
    return f" Not trained: {'; '.join(', '.join(models) + where for where, models in names.items())}."
