"""Tables of the analysis for the documents and the page: frames in, `Cells` out.

The frames are those of `evaluation.analysis.gather` by their names, with `claims`, `generalization` and `costs`.
"""

import itertools

import pandas as pd

from repro.baselines.names import BOUNDS, LIMITS, OTHER_BOUNDS, rank
from repro.config import NO_DECAY, PROJECTION
from repro.metrics.names import SUMMARY
from repro.networks.model import NETWORKS
from repro.reporting.claims import count_verdicts, on_paper
from repro.reporting.names import machine_title, predictor_title, short_commit, tested_titles
from repro.reporting.plots import DataFrames
from repro.reporting.render import Cells, cells_of, number, with_interval
from repro.runs.keys import CELL
from repro.runs.provenance import Provenance

BOUND = BOUNDS[0]
PROBABILISTIC = {"best_iou": "IoU at its best threshold", "log_loss": "Log loss [nat]", "brier": "Brier score"}
CALIBRATION = {
    "brier": ("Brier", 4),
    "reliability": ("reliability", 4),
    "resolution": ("resolution", 4),
    "log_loss": ("log-loss", 4),
    "calibration_error": ("calibration error", 4),
    "uncertain_error": ("where uncertain", 4),
}
COST = {
    "channels": ("channels", 0),
    "parameters": ("parameters", 0),
    "training_seconds": ("training [s]", 0),
    "peak_memory_gb": ("memory [GB]", 1),
}
COSTS = {
    "size_px": ("Image [px]", 0),
    "parameters_m": ("Parameters [M]", 2),
    "forward_gflop": ("Forward [GFLOP]", 2),
    "training_min": ("Training [min]", 1),
    "cpu_eager_ms": ("CPU, eager [ms]", 1),
    "cpu_onnx_ms": ("CPU, ONNX Runtime [ms]", 1),
    "cuda_eager_ms": ("GPU, eager [ms]", 1),
}
DIFFERENCE = {"value": ("difference", 4), "low": ("low", 4), "high": ("high", 4)}
CLAIMS_NOTE = """
Ours and Paper are values of the test, mostly differences (for the calibration, 0.02 minus the error).
Ours is of the combination that is closest to failing on our numbers, Paper of the one that is closest on
the paper's, which may be another one (for claims about most conditions, of the median one). In brackets:
interval of 95 %; in parentheses: claimed value, which is that of the paper for its tables, and tolerance.
A claim that a number exceeds a value needs a difference of at least the tolerance.

"""


def claims(frames: DataFrames) -> str:
    """Return the number of claims per verdict, then one row per claim with its test, our number and the paper's."""
    rows = []
    for _, row in frames["claims"].iterrows():
        ours = with_interval(row["value"], row["low"], row["high"])
        if ours:
            ours += f" ({row['claimed']:.3g} ± {row['tolerance']:.2g})"
        test = row["means"] if pd.notna(row["means"]) else row["reason"]
        rows.append((row["quote"], test, row["verdict"], row["ours"], ours, on_paper(row, ".3f")))
    table = Cells(("Claim", "Test", "Verdict", "On our numbers", "Ours", "Paper"), rows)
    return f"**{count_verdicts(frames['claims'])}.**\n{CLAIMS_NOTE}{table.to_markdown()}"


def methods(frames: DataFrames, caption: str) -> Cells:
    """Return U-Net with every encoding, the other networks and the baselines, experiments side by side.

    Where the upper bound is evaluated, the last columns have the obstacle IoU as a share of that of the bound.
    """
    intervals = frames["intervals"]
    hidden = {"average", *OTHER_BOUNDS} - set(LIMITS)
    is_shown = intervals["metric"].isin(SUMMARY) & ~intervals["model"].isin(hidden)
    rows = intervals[is_shown & ~intervals["encoding"].str.endswith(NO_DECAY)]
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
    return Cells(("Model", "Seeds", *heads, *(f"Exp. {name}: share of the bound" for name in bounded)), shown, caption)


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


def bounds(frames: DataFrames, caption: str) -> Cells:
    """Return the upper bound with more and less knowledge, one row per experiment and bound."""
    intervals, recency = frames["intervals"], frames["recency"]
    of_map = recency[(recency["recency"] == "all") & recency["metric"].isin(PROBABILISTIC)]
    texts = _texts(pd.concat([intervals[intervals["metric"].isin(SUMMARY)], of_map]))
    evaluated = set(zip(intervals["experiment"], intervals["model"], strict=True))
    shown = [
        (name, predictor_title(bound, ""), *(texts.get((name, bound, "", m), "") for m in (*SUMMARY, *PROBABILISTIC)))
        for name, bound in itertools.product(sorted(intervals["experiment"].unique()), BOUNDS)
        if (name, bound) in evaluated
    ]
    return Cells(("Exp.", "Predictor", *SUMMARY.values(), *PROBABILISTIC.values()), shown, caption)


def costs(frame: pd.DataFrame, caption: str) -> Cells:
    """Return one row per network and resolution, without columns that are empty everywhere."""
    encodings = frame.get("encoding", pd.Series(PROJECTION, frame.index))
    titles = [predictor_title(*names) for names in zip(frame["model"], encodings, strict=True)]
    return cells_of(frame.dropna(axis="columns", how="all").assign(model=titles), ["model"], COSTS, caption)


def tables_of_sections(frames: DataFrames, origins: dict[str, Provenance]) -> dict[str, list[Cells]]:
    """Return the tables of each section of the page, by its id; some may have no rows.

    Args:
        frames: the frames.
        origins: provenance of each run by its path.
    """
    calibration = frames["calibration"][frames["calibration"]["recency"] == "all"]
    calibration = calibration[calibration["model"].isin(NETWORKS)]
    return {
        "calibration": [cells_of(_sorted(calibration), CELL, CALIBRATION, "Calibration of the paper's networks")],
        "baselines": [
            cells_of(
                _to_the_papers(frames["differences"]),
                ["experiment", "model", "input"],
                DIFFERENCE,
                "Obstacle IoU with other inputs and without the decay, minus that with the paper's input",
            ),
            cells_of(_sorted(frames["cost"]), CELL, COST, "Size of the networks, and time and memory of a training"),
        ],
        "generalization": across(frames["generalization"]) if "generalization" in frames else [],
        "provenance": [_origins(origins)],
    }


def across(frame: pd.DataFrame) -> list[Cells]:
    """Return for each network obstacle IoU and accuracy, trained on one experiment (row), tested on one (column)."""
    rows = frame[frame["shift"] == "experiment"]
    rows = rows[rows["metric"].isin(["obstacle_iou", "accuracy"])].sort_values("metric", ascending=False, kind="stable")
    tables = []
    for title, own_rows in rows.groupby(tested_titles(rows), sort=False):
        trained, tested = (list(dict.fromkeys(own_rows[name])) for name in ("trained", "tested"))
        texts = own_rows["value"].map(number).groupby([own_rows["trained"], own_rows["tested"]]).agg(" / ".join)
        cells = [[name, *(texts.get((name, on), "") for on in tested)] for name in trained]
        heads = ["Trained on", *(f"tested on {name}" for name in tested)]
        tables.append(Cells(heads, cells, f"{title}: obstacle IoU / accuracy"))
    return tables


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


def _sorted(frame: pd.DataFrame) -> pd.DataFrame:
    """Sort rows of cells as in the tables, by experiment, model and encoding."""
    order = frame.assign(rank=frame["model"].map(rank)).sort_values(["experiment", "rank", "model", "encoding"])
    return order.drop(columns="rank")


def _to_the_papers(differences: pd.DataFrame) -> pd.DataFrame:
    """Select the differences in obstacle IoU between other inputs, the ablation included, and the paper's input."""
    rows = _obstacle_iou(differences).query("comparison in ['decay', 'encodings']")
    to_paper, from_paper = rows[rows["other"] == PROJECTION], rows[rows["one"] == PROJECTION]
    negated = {"value": -from_paper["value"], "low": -from_paper["high"], "high": -from_paper["low"]}
    both = pd.concat([to_paper, from_paper.assign(one=from_paper["other"], **negated)])
    return _sorted(both.assign(encoding=both["one"])).rename(columns={"encoding": "input"})


def _origins(origins: dict[str, Provenance]) -> Cells:
    rows = []
    for path, step in ((path, origin.steps[-1]) for path, origin in origins.items() if origin.steps):
        hardware, commit = machine_title(**step["hardware"]), short_commit(step["commit"])
        rows.append([path, commit, step["written"][:10], hardware, step["versions"]["torch"]])
    return Cells(["Run", "Commit", "Date", "Hardware", "torch"], rows, "Last step of each run", 5)
