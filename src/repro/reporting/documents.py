"""Tables of the documents: Markdown from reproduce/results, between the marks of a document.

The frames of the tables are those of `evaluation.frames.gather` by their names, with `claims` and `costs`.
"""

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from repro.baselines.titles import rank
from repro.metrics.headings import SUMMARY
from repro.reporting.claims import Verdict, count_verdicts, on_paper
from repro.reporting.names import TITLES, predictor_title
from repro.reporting.plots import DataFrames
from repro.reporting.render import Cells, number, with_interval
from repro.reporting.results import read_frames, read_published
from repro.reporting.tables import Table, caption, make_tables, missing
from repro.runs.config import PROJECTION
from repro.runs.keys import CELL
from repro.system.errors import InputError

MARKS = re.compile(r"(<!-- results: ([\w-]+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
BOUND = "privileged"
COSTS = {
    "size_px": ("Image [px]", 0),
    "parameters_m": ("Parameters [M]", 2),
    "forward_gflop": ("Forward [GFLOP]", 2),
    "training_min": ("Training [min]", 1),
    "cpu_eager_ms": ("CPU, eager [ms]", 1),
    "cpu_onnx_ms": ("CPU, ONNX Runtime [ms]", 1),
    "cuda_eager_ms": ("GPU, eager [ms]", 1),
}
CLAIMS_NOTE = """
A claim holds if it holds in every experiment and network that it names, or in most where it speaks of most. The columns
Ours and Paper show its hardest case: the number that leaves the least room to the claim, or the median where it speaks
of most. Most numbers are differences between two results; that of the calibration is 0.02 minus the error. The interval
of 95 % is in brackets, the claimed value and its tolerance in parentheses. A claim that a number exceeds a value needs
a difference of at least the tolerance.

"""


def claims(frames: DataFrames) -> Cells:
    """Return one row per claim with its test, our number and the paper's; claims without their runs are left out."""
    rows, judged = [], frames["claims"]
    for _, row in judged[(judged["ours"] != Verdict.untested) | judged["reason"].notna()].iterrows():
        ours = with_interval(row["value"], row["low"], row["high"])
        if ours:
            ours += f" ({row['claimed']:.3g} ± {row['tolerance']:.2g})"
        test = row["means"] if pd.notna(row["means"]) else row["reason"]
        rows.append((row["quote"], test, row["verdict"], row["ours"], ours, on_paper(row)))
    return Cells(("Claim", "Test", "Verdict", "On our numbers", "Ours", "Paper"), rows, text_columns=6)


def methods(frames: DataFrames, caption: str) -> Cells:
    """Return U-Net with every encoding, the other networks and the baselines, experiments side by side.

    Where the upper bound is evaluated, the last columns have the obstacle IoU as a share of that of the bound.
    """
    intervals = frames["intervals"]
    rows = intervals[intervals["metric"].isin(SUMMARY) & (intervals["model"] != "average")]
    inputs = rows[rows["encoding"] != ""].groupby("experiment")["encoding"].nunique()
    chosen = sorted(inputs.index[inputs == inputs.max()])  # the experiments with most inputs
    rows = rows[rows["experiment"].isin(chosen)]
    bounded = [name for name in chosen if name in set(rows.loc[rows["model"] == BOUND, "experiment"])]
    texts, shares = _texts(rows), _shares(rows)
    shown = []
    cells = set(zip(rows["model"], rows["encoding"], strict=True))
    for model, encoding in sorted(cells, key=lambda cell: (rank(cell[0]), cell[1] != PROJECTION, cell[1], cell[0])):
        seeds = rows.loc[(rows["model"] == model) & (rows["encoding"] == encoding), "seeds"]
        counts = sorted({f"{count:.0f}" for count in seeds}) if encoding else []
        values = [texts.get((name, model, encoding, metric), "") for name in chosen for metric in SUMMARY]
        values += [number(shares.get((name, model, encoding)), 2) for name in bounded]
        shown.append((predictor_title(model, encoding), " to ".join(counts), *values))
    heads = [f"Exp. {name}: {head}" for name in chosen for head in SUMMARY.values()]
    return Cells(
        ("Model", "Seeds", *heads, *(f"Exp. {name}: share of the bound" for name in bounded)),
        shown,
        caption,
        text_columns=2,
    )


def networks(frames: DataFrames, caption: str) -> Cells:
    """Return networks and inputs in experiments 3 and 4: obstacle IoU, its share of the bound, log loss; and costs."""
    calibration = frames["calibration"][frames["calibration"]["recency"] == "all"]
    measures = {
        "obstacle IoU": (_obstacle_iou(frames["intervals"]).set_index(CELL)["value"], 3),
        "share of the bound": (_shares(frames["intervals"]), 2),
        "log loss [nat]": (calibration.set_index(CELL)["log_loss"], 3),
    }
    columns = [(name, head, *measures[head]) for name, head in itertools.product(("3", "4"), measures)]
    rows = []
    for row in frames["costs"].dropna(subset="training_min").itertuples():
        measured = [number(values.get((name, row.model, row.encoding)), digits) for name, _, values, digits in columns]
        costs = (f"{row.parameters_m:.2f}", f"{row.training_min:.1f}", f"{row.cpu_onnx_ms:.0f}")
        rows.append((predictor_title(str(row.model), str(row.encoding)), *measured, *costs))
    heads = [f"Exp. {name}: {head}" for name, head, *_ in columns]
    return Cells(("Network, input", *heads, "Parameters [M]", "Training [min]", "Latency [ms]"), rows, caption)


def mappers(frames: DataFrames, caption: str) -> Cells:
    """Return success and time of all mappers and the lead of the network, a row each, from navigation.csv."""
    results = frames["navigation"]
    experiments, rows = list(results["experiment"].unique()), []
    for title, own in results.groupby("title", sort=False):
        of = own.set_index("experiment")
        success = [with_interval(*of.loc[name, ["success", "low", "high"]]) for name in experiments]
        lead, low, high = map(float, of.loc["all", ["lead", "lead_low", "lead_high"]])
        rows.append([title, *success, number(of.loc["all", "time_s"], 1), with_interval(lead, low, high, "+.3f")])
    return Cells(["Map", *map(str.capitalize, experiments), "Time [s]", "All, lead of the best network"], rows, caption)


def costs(frame: pd.DataFrame, caption: str) -> Cells:
    """Return one row per network and resolution, without columns that are empty everywhere."""
    frame = frame.dropna(axis="columns", how="all")
    encodings = frame.get("encoding", pd.Series(PROJECTION, frame.index))
    titles = [predictor_title(*names) for names in zip(frame["model"], encodings, strict=True)]
    heads = {column: head for column, (head, _) in COSTS.items() if column in frame}
    numbers = [frame[column].map(lambda value, column=column: number(value, COSTS[column][1])) for column in heads]
    return Cells(("Model", *heads.values()), list(zip(titles, *numbers, strict=True)), caption)


def _texts(rows: pd.DataFrame) -> pd.Series:
    """Return values with their intervals as texts by experiment, model, encoding and metric."""
    texts = [with_interval(*row) for row in zip(rows["value"], rows["low"], rows["high"], strict=True)]
    return rows.assign(text=texts).set_index([*CELL, "metric"])["text"]


def _obstacle_iou(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows["metric"] == "obstacle_iou"]


def _shares(rows: pd.DataFrame) -> pd.Series:
    """Return the obstacle IoU as a share of that of the upper bound by experiment, model and encoding."""
    iou = _obstacle_iou(rows)
    of_bound = iou[iou["model"] == BOUND].set_index("experiment")["value"]
    return iou.assign(share=iou["value"] / iou["experiment"].map(of_bound)).set_index(CELL)["share"]


ANALYZED: dict[str, tuple[Callable[[DataFrames, str], Cells], str]] = {  # tables of the analysis with their titles
    "methods": (methods, "Networks, other inputs, baselines and the upper bound, with 95 % intervals"),
    "networks": (
        networks,
        "Networks and inputs; training on one CPU thread, latency of a window in ONNX Runtime on two",
    ),
    "mappers": (
        mappers,
        "Share of the courses in which the robot reaches both goals, with 95 % intervals; mean time of the successes",
    ),
}


def with_results(text: str, results: Path) -> str:
    """Return a document with the tables between its marks regenerated from the published results.

    A mark is `<!-- results: laptop main -->`, closed by `<!-- end -->`. Instead of `main` it may name another table
    (`ablation`, `costs`, `claims`, `methods`, `networks`, `mappers`), or one network or `average` for its
    rows in both tables.

    Raises:
        InputError: a mark is not closed before the next one.
    """
    begins, ends = text.count("<!-- results:"), len(MARKS.findall(text))
    if begins != ends or any("<!-- results:" in match[0][len(match[1]) :] for match in MARKS.finditer(text)):
        raise InputError("every mark <!-- results: ... --> needs its own <!-- end --> before the next mark")

    def table(match: re.Match[str]) -> str:
        return match[1] + _markdown(results / match[2], match[3]) + match[4]

    return MARKS.sub(table, text)


def _markdown(directory: Path, name: str) -> str:
    """Return the table that a mark names, from a published directory."""
    if name in (*ANALYZED, "claims", "costs"):
        try:
            return _analyzed(directory, name)
        except KeyError as error:
            raise InputError(f"{directory}: {name} needs the table or column {error}: restore the CSV files") from error
    runs = read_published(directory)
    tables = make_tables(runs)
    if name in TITLES:
        return _rows_of_model(runs, tables, name).to_markdown()
    if name not in tables:
        known = ", ".join([*ANALYZED, "claims", "costs", *tables])
        raise InputError(f"results: {directory.name} {name}: expected {known}, or a network")
    return tables[name].to_markdown()


def _analyzed(directory: Path, name: str) -> str:
    frames = read_frames(directory)
    if name == "claims":
        return f"**{count_verdicts(frames['claims'])}.**\n{CLAIMS_NOTE}{claims(frames).to_markdown()}"
    if name == "costs":
        measured, note = frames["costs"], (directory / "costs.txt").read_text(encoding="utf-8").strip()
        return costs(measured, note).to_markdown()
    facts = caption(read_published(directory)) if (directory / "runs.csv").is_file() else ""  # of its trainings
    return analyzed(name, frames, f" {facts[: facts.index(', seed')]}." * bool(facts)).to_markdown()


def analyzed(name: str, frames: DataFrames, facts: str = "") -> Cells:
    """Return a table of `ANALYZED`, with facts after its title."""
    make, title = ANALYZED[name]
    return make(frames, f"{title}.{facts}")


def _rows_of_model(runs: pd.DataFrame, tables: dict[str, Table], model: str) -> Table:
    """Select the rows of one model, or of the average, from the main table and the ablation."""
    rows, ablation = tables["main"].frame, tables["ablation"].frame
    if len(ablation):
        rows = pd.concat([rows, ablation.assign(experiment=ablation["experiment"] + ", no decay")])
    return Table(rows[rows["model"] == model], caption(runs) + missing(runs, PROJECTION))
