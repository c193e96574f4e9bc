"""The paper's numbers and ours with their intervals, looked up by name in the tests of the claims."""

from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
import pandas as pd
from uncertainties import ufloat

from repro.baselines.names import BASELINES, OTHER_BOUNDS
from repro.config import NETWORKS, PROJECTION
from repro.evaluation.breakdown import HITS, measures
from repro.evaluation.recency import RECENCY
from repro.metrics.calibration import summary
from repro.metrics.counts import LEVELS, pooled_scores
from repro.metrics.names import METRICS, SUMMARY
from repro.reporting.audit import free_share
from repro.reporting.names import TITLES
from repro.reporting.paper import read_paper
from repro.runs.keys import CELL
from repro.system.errors import InputError

Z = 1.96  # half-width of a 95 % interval in standard errors
Number = Any  # a float, or a number of `uncertainties` with its standard error
_COUNTS = np.ones((2, LEVELS))  # of which only the names of the metrics are used
METRICS_OF = {  # the metrics of each table of numbers
    "tables": {"ssim", "ssim_binary", *pooled_scores(_COUNTS)},
    "recency": {"pixel_share", *measures(_COUNTS)},
    "obstacles": {"obstacles", "recall", "detected"},
    "calibration": {*summary(_COUNTS), "temperature", *SUMMARY},
    "cost": {"parameters", "channels", "training_seconds", "peak_memory_gb"},
}


class Numbers:
    """Numbers looked up as m(metric, exp, ...) in the tests of claims.yaml.

    Args:
        rows: of (the table), experiment, model, encoding, recency, metric, value; low and high, nan if unknown.
        models: further models than those of the rows that a test may name.
    """

    def __init__(self, rows: pd.DataFrame, models: Iterable[str] = ()) -> None:
        self.models = {*TITLES, *rows["model"], *models}
        keys = ["of", "metric", *CELL, "recency"]
        rows = rows.dropna(subset=["value"]).drop_duplicates(keys, keep="last")
        error = ((rows["high"] - rows["low"]) / (2 * Z)).fillna(0.0)
        self.numbers = {
            tuple(key): ufloat(value, spread) if spread else value
            for *key, value, spread in zip(*(rows[key] for key in keys), rows["value"], error, strict=True)
        }
        self.networks = len(set(rows["model"]) & set(NETWORKS))

    def m(
        self,
        metric: str,
        exp: str | list[str],
        model: str = "average",
        encoding: str = PROJECTION,
        recency: str = "all",
        of: str = "tables",
    ) -> Number:
        """Return a number of an experiment, or its mean over a list of experiments.

        Raises:
            KeyError: the number has not been measured.
            ValueError: there is no such table, metric, model or recency.
        """
        _check("table", of, METRICS_OF)
        _check(f"metric of {of}", metric, METRICS_OF[of])
        _check("model", model, self.models)
        _check("recency", recency, {"all", *RECENCY, *HITS})
        experiments = [exp] if isinstance(exp, str) else exp
        encoding = "" if model in (*BASELINES, *OTHER_BOUNDS) else encoding
        return sum(self.numbers[of, metric, e, model, encoding, recency] for e in experiments) / len(experiments)


def _check(kind: str, name: str, known: Collection[str]) -> None:
    """Check that a name is known.

    Raises:
        ValueError: it is not.
    """
    if name not in known:
        raise InputError(f"expected a {kind}: {', '.join(sorted(known))}; got {name!r}")


def paper_rows() -> pd.DataFrame:
    """Return the paper's tables as tidy rows, with the implied scores of an all-free prediction on its maps."""
    table = read_paper()
    free = [
        {**row, "model": "all_free", "encoding": "", "accuracy": share, "dice": 2 * share / (1 + share)}
        for row in table[(table["model"] == "average") & (table["encoding"] == PROJECTION)].to_dict("records")
        for share in [free_share({str(name): value for name, value in row.items()})]
    ]
    rows = pd.concat([table, pd.DataFrame(free)[[*CELL, "accuracy", "dice"]]])
    long = rows.melt(CELL, list(METRICS), "metric")
    return long.assign(of="tables", recency="all", low=float("nan"), high=float("nan"))


def analysis_rows(frames: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the frames of `evaluation.analysis.gather` as tidy rows."""
    parts = [frames["intervals"].assign(of="tables", recency="all")]
    calibration = frames["calibration"]
    parts += [frames["recency"].assign(of="recency")]
    parts += [frames["obstacles"].rename(columns={"last_hit": "recency"}).assign(of="obstacles")]
    for of, frame in {
        "calibration": calibration[calibration["method"] == "uncalibrated"].drop(columns="method"),
        "cost": frames["cost"].assign(recency="all"),
    }.items():
        parts.append(frame.melt([*CELL, "recency"], var_name="metric").assign(of=of))
    rows = pd.concat(parts, ignore_index=True)
    columns = [*CELL, "of", "recency", "metric", "value", "low", "high"]
    return rows.assign(experiment=rows["experiment"].astype(str))[columns]
