"""The paper's tables from tidy rows: a frame and a caption that states data, seeds, and which networks are missing."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from repro.config import NO_DECAY, PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.names import HEADINGS, TABLE_METRICS
from repro.networks.model import NETWORKS
from repro.reporting.names import model_title, predictor_title
from repro.reporting.paper import read_paper
from repro.reporting.render import Cells, number
from repro.reporting.results import OURS, compare, read_results, select
from repro.reporting.rows import Settings, changed, read_cells, usual
from repro.runs.keys import CELL
from repro.runs.outputs import Outputs
from repro.system.files import write_text

HEADS = {name: HEADINGS.get(name, name) for name in TABLE_METRICS}
TABLE_TITLES = {
    "main": "Prediction metrics",
    "ablation": "Prediction metrics without the gray-scale time decay",
}
TABLE_ENCODINGS = {"main": PROJECTION, "ablation": PROJECTION_NO_DECAY}  # encoding of the networks in each table


@dataclass(frozen=True)
class Table:
    """Rows with named columns, and their caption; empty if no run is evaluated. The note is for the terminal."""

    frame: pd.DataFrame
    caption: str
    note: str = ""

    @property
    def has_paper(self) -> bool:
        """Whether the paper has numbers for some rows; it has none for other worlds."""
        return bool(self.frame.filter(like="paper_").notna().any(axis=None))

    def to_markdown(self) -> str:
        """Return the table as Markdown, one row per model: our number, and the paper's in brackets."""
        if self.frame.empty:
            return f"**{self.caption}**\n"
        brackets = " Ours (paper)." if self.has_paper else ""
        return f"**{self.caption}**{brackets}\n\n" + self._cells().to_markdown()

    def to_latex(self) -> str:
        """Return the table as LaTeX, see `to_markdown`."""
        return self._cells().to_latex()

    def write(self, directory: Path, name: str) -> None:
        """Write <name>.csv, <name>.md and <name>.tex to a directory."""
        write_text(directory / f"{name}.csv", self.frame.to_csv(index=False, float_format="%.4f"))
        write_text(directory / f"{name}.md", self.to_markdown())
        write_text(directory / f"{name}.tex", self.to_latex())

    def _cells(self) -> Cells:
        rows = [
            (row["experiment"], row_title(row), *(_ours(row, metric) + _paper(row, metric) for metric in TABLE_METRICS))
            for _, row in self.frame.iterrows()
        ]
        return Cells(("Exp.", "Model", *HEADS.values()), rows)


def row_title(row: pd.Series) -> str:
    """Return the title of a row: its model, and its encoding unless it is that of the table."""
    encoding = str(row["encoding"])
    mark = " (ours)" if (row["model"], encoding) == OURS else ""
    return predictor_title(row["model"], encoding.removesuffix(NO_DECAY)) + mark


def make_tables(results: pd.DataFrame) -> dict[str, Table]:
    """Create the main table and the ablation from tidy rows; a table without rows is empty."""
    tables = {}
    for name, encoding in TABLE_ENCODINGS.items():
        rows = select(results, encoding) if len(results) else results
        note = _not_shown(results) if name == "main" else ""
        if rows.empty:
            tables[name] = Table(pd.DataFrame(), f"{TABLE_TITLES[name]}. No run evaluated yet.", note)
        else:
            facts = caption(rows) + missing(rows, encoding)
            tables[name] = Table(compare(results, encoding), f"{TABLE_TITLES[name]}. {facts}", note)
    return tables


def _not_shown(results: pd.DataFrame) -> str:
    """Count the evaluated networks and inputs that are in neither table; empty if none."""
    if results.empty:
        return ""
    shown = pd.concat([select(results, encoding) for encoding in TABLE_ENCODINGS.values()]).index
    others = results[(results["encoding"] != "") & ~results.index.isin(shown)]
    titles = list(dict.fromkeys(map(predictor_title, others["model"], others["encoding"])))
    if not titles:
        return ""
    more = f" and {len(titles) - 1} more networks and inputs" if titles[1:] else ""
    return f"Evaluated, but in the tables of task=analysis only: {titles[0]}{more}."


def write_tables(outputs: Outputs, errors: list[str] | None = None) -> dict[str, Table]:
    """Write the main table and the ablation of all evaluated runs to outputs/tables; see `read_results`."""
    tables = make_tables(read_results(outputs, errors))
    outputs.tables.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        if len(table.frame):
            table.write(outputs.tables, name)
        else:  # the runs of an earlier table have been deleted
            for path in outputs.tables.glob(f"{name}.*"):
                path.unlink()
    return tables


def _ours(row: pd.Series, metric: str) -> str:
    spread = number(row.get(f"std_{metric}"))
    return number(row.get(metric)) + (f" ± {spread}" if spread else "")  # an old result may lack a young metric


def _paper(row: pd.Series, metric: str) -> str:
    value = number(row.get(f"paper_{metric}"))
    return f" ({value})" if value else ""


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
    return (
        f"Scale {first['scale']}: {first['size_px']} x {first['size_px']} px, {int(first['train_pairs'])} training and "
        f"{int(first['test_pairs'])} test pairs per experiment, {epochs} epochs, "
        f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}{uneven}."
        f"{_other_worlds(networks)}{_unlike(networks)}"
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


def _other_worlds(networks: pd.DataFrame) -> str:
    """Name the experiments of other worlds than the paper's beside some of the paper's."""
    is_other = networks.get("papers_worlds", pd.Series(True, networks.index)).eq(False)  # older results lack it
    others = sorted(networks.loc[is_other, "experiment"].unique())
    return f" Not the paper's worlds: exp {', '.join(others)}." if others and not is_other.all() else ""


def _comparable(model: str, settings: Settings) -> Settings:
    """Return the settings without those of the model, unless it is one of the paper's, which share them."""
    if model in NETWORKS:
        return settings
    return {key: value for key, value in settings.items() if not key.startswith("model.")}


def _unlike(networks: pd.DataFrame) -> str:
    """Name the networks of a table that were trained with other settings than most."""
    if "settings" not in networks:  # all were published before the column existed
        return ""
    settings = list(map(_comparable, networks["model"], read_cells(networks["settings"])))
    reference = usual(settings)
    texts = [", ".join(f"{key}={value}" for key, value in changed(each, reference).items()) for each in settings]
    groups = networks.assign(changed=texts).query("changed != ''").groupby(["changed", "model"])
    unlike = [
        f"{model_title(str(model))} in exp {', '.join(sorted(rows['experiment'].unique()))} ({text})"
        for (text, model), rows in groups
    ]
    return f" Not trained like the others: {'; '.join(unlike)}." if unlike else ""
