"""Numbers by name, the paper's and ours, with their intervals: what the tests of the claims are made of."""

from typing import Any

import pandas as pd
from uncertainties import ufloat

from repro.baselines.names import BASELINES
from repro.config import NETWORKS, PROJECTION
from repro.metrics.names import METRICS
from repro.reporting.audit import free_share
from repro.reporting.paper import read_paper
from repro.runs.keys import CELL

Z = 1.96  # half an interval of 95 % in standard errors
Number = Any  # a float, or one of `uncertainties` with its standard error


class Numbers:
    """Numbers by name, for the tests of the ledger: m(metric, exp, ...).

    Args:
        rows: of, experiment, model, encoding, recency, metric, value and, where known, low and high.
    """

    def __init__(self, rows: pd.DataFrame) -> None:
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
        """Finds a number, the mean over a list of experiments.

        Raises:
            KeyError: it is not there.
        """
        experiments = [exp] if isinstance(exp, str) else exp
        encoding = "" if model in BASELINES else encoding
        return sum(self.numbers[of, metric, e, model, encoding, recency] for e in experiments) / len(experiments)


def paper_rows() -> pd.DataFrame:
    """Makes rows of the paper's tables, with what calling everything free would score on its maps."""
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
    """Makes rows of the frames of `evaluation.analysis.gather`."""
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
