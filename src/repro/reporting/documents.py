"""Tables of the documents: Markdown from reproduce/results, between the marks of a document."""

import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from repro.baselines.names import BOUNDS, LIMITS, OTHER_BOUNDS, rank
from repro.config import NO_DECAY, PROJECTION
from repro.metrics.names import SUMMARY
from repro.reporting.claims import count_verdicts, on_paper
from repro.reporting.names import TITLES, predictor_title
from repro.reporting.render import Cells, number, with_interval
from repro.reporting.results import read_published
from repro.reporting.rows import read_rows
from repro.reporting.tables import Table, caption, costs_to_markdown, make_tables, missing
from repro.system.errors import InputError

MARKS = re.compile(r"(<!-- results: ([\w-]+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
BOUND = BOUNDS[0]
PROBABILISTIC = ("best_iou", "log_loss", "brier")


def with_results(text: str, results: Path) -> str:
    """Return a document with the tables between its marks regenerated from the published results.

    A mark is `<!-- results: laptop main -->`, closed by `<!-- end -->`. Instead of `main` it may name another table
    (`ablation`, `costs`, `claims`, `methods`, `bounds`, `networks`), or one network or `average` for its rows in both
    tables.

    Raises:
        ValueError: a mark is not closed before the next one.
    """
    begins, ends = text.count("<!-- results:"), len(MARKS.findall(text))
    if begins != ends or any("<!-- results:" in match[0][len(match[1]) :] for match in MARKS.finditer(text)):
        raise InputError("every mark <!-- results: ... --> needs its own <!-- end --> before the next mark")

    def table(match: re.Match[str]) -> str:
        return match[1] + _markdown(results / match[2], match[3]) + match[4]

    return MARKS.sub(table, text)


def _markdown(directory: Path, name: str) -> str:
    """Return the table that a mark names, from a published directory."""
    if name in MADE:
        try:
            return MADE[name](directory)
        except KeyError as error:
            raise InputError(f"{directory}: {name} needs the column {error}: restore the CSV files") from error
    runs = read_published(directory)
    tables = make_tables(runs)
    if name in TITLES:
        return _rows_of_model(runs, tables, name).to_markdown()
    if name not in tables:
        known = ", ".join([*MADE, *tables])
        raise InputError(f"results: {directory.name} {name}: expected {known}, or a network")
    return tables[name].to_markdown()


def _rows_of_model(runs: pd.DataFrame, tables: dict[str, Table], model: str) -> Table:
    """Select the rows of one model, or of the average, from the main table and the ablation."""
    rows, ablation = tables["main"].frame, tables["ablation"].frame
    if len(ablation):
        rows = pd.concat([rows, ablation.assign(experiment=ablation["experiment"] + ", no decay")])
    return Table(rows[rows["model"] == model], caption(runs) + missing(runs, PROJECTION))


def _analyzed(directory: Path, name: str) -> pd.DataFrame:
    """Load a published table of the analysis."""
    return read_rows(directory / "analysis" / f"{name}.csv")


def _titled(directory: Path, title: str) -> str:
    """Return a caption with the scale of a published directory."""
    whole = caption(read_published(directory))
    return f"{title}. {whole[: whole.index(', seed')]}."


def _costs(directory: Path) -> Table:
    return Table(read_rows(directory / "costs.csv"), (directory / "costs.txt").read_text(encoding="utf-8").strip())


def claims_to_markdown(claims: pd.DataFrame) -> str:
    """Return the number of claims per verdict, then one row per claim with its test, our number and the paper's.

    Args:
        claims: see `claims.judge`.
    """
    lines = [
        f"**{count_verdicts(claims)}.**",
        "",
        "Ours and Paper are values of the test, mostly differences (for the calibration, 0.02 minus the error).",
        "Ours is of the combination that is closest to failing on our numbers, Paper of the one that is closest on",
        "the paper's, which may be another one (for claims about most conditions, of the median one). In brackets:",
        "interval of 95 %; in parentheses: claimed value, which is that of the paper for its tables, and tolerance.",
        "A claim that a number exceeds a value needs a difference of at least the tolerance.",
        "",
    ]
    rows = []
    for _, row in claims.iterrows():
        ours = ""
        if pd.notna(row["value"]):
            needed = f"{row['claimed']:.3g} ± {row['tolerance']:.2g}"
            ours = f"{with_interval(row['value'], row['low'], row['high'])} ({needed})"
        paper = on_paper(row, ".3f")
        test = row["means"] if pd.notna(row["means"]) else row["reason"]
        rows.append((row["quote"], test, row["verdict"], row["ours"], ours, paper))
    heads = ("Claim", "Test", "Verdict", "On our numbers", "Ours", "Paper")
    return "\n".join(lines) + "\n" + Cells(heads, rows).to_markdown()


def methods_to_markdown(intervals: pd.DataFrame, caption: str) -> str:
    """Return a table of U-Net with every encoding, the other networks and the baselines, experiments side by side.

    Where the upper bound is evaluated, the last columns have the obstacle IoU as a share of that of the bound.

    Args:
        intervals: experiment, model, encoding, metric, value, low, high, seeds.
        caption: the caption.
    """
    hidden = {"average", *OTHER_BOUNDS} - set(LIMITS)
    is_shown = intervals["metric"].isin(SUMMARY) & ~intervals["model"].isin(hidden)
    rows = intervals[is_shown & ~intervals["encoding"].str.endswith(NO_DECAY)]
    inputs = rows[rows["encoding"] != ""].groupby("experiment")["encoding"].nunique()
    chosen = sorted(inputs.index[inputs == inputs.max()])  # the experiments with most inputs
    rows = rows[rows["experiment"].isin(chosen)]
    bounds = rows[(rows["model"] == BOUND) & (rows["metric"] == "obstacle_iou")].set_index("experiment")["value"]
    heads = [f"Exp. {e}: {head}" for e in chosen for head in SUMMARY.values()]
    heads += [f"Exp. {e}: share of the bound" for e in chosen if e in bounds]
    shown = []
    cells = set(zip(rows["model"], rows["encoding"], strict=True))
    for model, encoding in sorted(cells, key=lambda cell: (rank(cell[0]), cell[1] != PROJECTION, cell[1], cell[0])):
        own_rows = rows[(rows["model"] == model) & (rows["encoding"] == encoding)]
        values = [_cell(own_rows, experiment, metric) for experiment in chosen for metric in SUMMARY]
        iou = own_rows[own_rows["metric"] == "obstacle_iou"].set_index("experiment")["value"]
        values += [f"{iou[e] / bounds[e]:.2f}" if e in iou else "" for e in chosen if e in bounds]
        counts = sorted({f"{count:.0f}" for count in own_rows["seeds"]}) if encoding else []
        seeds = " to ".join(counts)
        shown.append((predictor_title(model, encoding), seeds, *values))
    return Cells(("Model", "Seeds", *heads), shown, caption).to_markdown()


def networks_to_markdown(
    intervals: pd.DataFrame, calibration: pd.DataFrame, costs: pd.DataFrame, caption: str, experiments: tuple[str, ...]
) -> str:
    """Return a table of networks and inputs: obstacle IoU, its share of the bound, log loss, and costs.

    Args:
        intervals: see `methods_to_markdown`.
        calibration: experiment, model, encoding, recency, log_loss.
        costs: model, encoding, size_px, parameters_m, training_min, cpu_eager_ms, cpu_onnx_ms.
        caption: the caption.
        experiments: the experiments to show.
    """
    iou = intervals[intervals["metric"] == "obstacle_iou"].set_index(["experiment", "model", "encoding"])["value"]
    of_map = calibration[calibration["recency"] == "all"]
    log_loss = of_map.set_index(["experiment", "model", "encoding"])["log_loss"]
    measures = {"obstacle IoU": iou, "share of the bound": iou, "log loss [nat]": log_loss}
    heads = [f"Exp. {experiment}: {head}" for experiment in experiments for head in measures]
    heads += ["Parameters [M]", "Training [min]", "Latency [ms]"]
    rows = []
    for row in costs.dropna(subset="training_min").itertuples():
        cells = []
        for experiment, (head, values) in itertools.product(experiments, measures.items()):
            value = values.get((experiment, row.model, row.encoding), math.nan)
            bound = iou.get((experiment, BOUND, ""), math.nan) if head == "share of the bound" else 1.0
            cells.append(number(value / bound, 2 if "share" in head else 3))
        cells += [f"{row.parameters_m:.2f}", f"{row.training_min:.1f}", f"{row.cpu_onnx_ms:.0f}"]
        rows.append((predictor_title(str(row.model), str(row.encoding)), *cells))
    return Cells(("Network, input", *heads), rows, caption).to_markdown()


def bounds_to_markdown(intervals: pd.DataFrame, recency: pd.DataFrame, caption: str) -> str:
    """Return a table of the upper bound with more and less knowledge, one row per experiment and bound.

    Args:
        intervals: see `methods_to_markdown`.
        recency: experiment, model, encoding, recency, metric, value, low, high.
        caption: the caption.
    """
    heads = [*SUMMARY.values(), "IoU at its best threshold", "Log loss [nat]", "Brier score"]
    shown = []
    for experiment in sorted(intervals["experiment"].unique()):
        of_map = recency[(recency["experiment"] == experiment) & (recency["recency"] == "all")]
        for name in BOUNDS:
            rows = intervals[(intervals["experiment"] == experiment) & (intervals["model"] == name)]
            if rows.empty:
                continue
            cells = [_cell(rows, experiment, metric) for metric in SUMMARY]
            cells += [_cell(of_map[of_map["model"] == name], experiment, metric) for metric in PROBABILISTIC]
            shown.append((experiment, predictor_title(name, ""), *cells))
    return Cells(("Exp.", "Predictor", *heads), shown, caption).to_markdown()


def _cell(rows: pd.DataFrame, experiment: str, metric: str) -> str:
    selected = rows[(rows["experiment"] == experiment) & (rows["metric"] == metric)]
    return "".join(with_interval(row["value"], row["low"], row["high"]) for row in selected.to_dict("records"))


MADE: dict[str, Callable[[Path], str]] = {  # tables from other files than runs.csv
    "costs": lambda path: costs_to_markdown(_costs(path)),
    "claims": lambda path: claims_to_markdown(_analyzed(path, "claims")),
    "methods": lambda path: methods_to_markdown(
        _analyzed(path, "intervals"),
        _titled(path, "Networks, other inputs, baselines and the upper bound, with 95 % intervals"),
    ),
    "bounds": lambda path: bounds_to_markdown(
        _analyzed(path, "intervals"),
        _analyzed(path, "recency"),
        _titled(path, "The upper bound with more and less knowledge, with 95 % intervals"),
    ),
    "networks": lambda path: networks_to_markdown(
        _analyzed(path, "intervals"),
        _analyzed(path, "calibration"),
        _costs(path).frame,
        _titled(path, "Networks and inputs; training on one CPU thread, latency of a window in ONNX Runtime on two"),
        ("3", "4"),
    ),
}
