"""The paper's numbers and ours with their intervals, looked up in the tests of the claims."""

from typing import Any

import pandas as pd
from uncertainties import ufloat

from repro.baselines.names import BASELINES, OTHER_BOUNDS
from repro.config import PROJECTION
from repro.metrics.calibration import Reliability, uncertain_error, uncertain_skill
from repro.metrics.names import METRICS
from repro.networks.model import NETWORKS
from repro.reporting.paper import all_free_dice, free_share, read_paper
from repro.runs.keys import CELL

Z = 1.96  # half-width of a 95 % interval in standard errors
Number = Any  # a float, or a number of `uncertainties` with its standard error


class Numbers:
    """Numbers by table, metric and cell; each method raises KeyError for a number that has not been measured.

    Args:
        rows: see `analysis_rows` and `paper_rows`.
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

    def table(self, metric: str, exp: str | list[str], model: str = "average", encoding: str = PROJECTION) -> Number:
        """Return a metric of the tables, for a list of experiments its mean."""
        experiments = [exp] if isinstance(exp, str) else exp
        encoding = "" if model in (*BASELINES, *OTHER_BOUNDS) else encoding
        return sum(self.numbers["tables", metric, e, model, encoding, "all"] for e in experiments) / len(experiments)

    def unet(self, of: str, metric: str, exp: str, group: str = "all", encoding: str = PROJECTION) -> Number:
        """Return a number of U-Net.

        Args:
            of: `recency` of pixels, `obstacles` by the time since their last hit, `uncertain` predictions, or `cost`.
            metric: the measure, of uncertain predictions `error` or `skill`, see `metrics.calibration`.
            exp: the experiment.
            group: the recency of the pixels, or the last hit of the obstacles.
            encoding: label of its encoding.
        """
        return self.numbers[of, metric, exp, "unet", encoding, group]


def paper_rows() -> pd.DataFrame:
    """Return the paper's tables as tidy rows, with the implied scores of an all-free prediction on its maps."""
    table = read_paper()
    average = table[(table["model"] == "average") & (table["encoding"] == PROJECTION)][[*CELL]]
    share = free_share(table.loc[average.index])
    free = average.assign(model="all_free", encoding="", accuracy=share, dice=all_free_dice(share))
    long = pd.concat([table, free]).melt(CELL, list(METRICS), "metric")
    return long.assign(of="tables", recency="all", low=float("nan"), high=float("nan"))


def analysis_rows(frames: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the frames of `evaluation.analysis.gather` as tidy rows.

    Returns:
        of (the table), experiment, model, encoding, recency, metric, value; low and high, nan if unknown.
    """
    cost = frames["cost"].melt(CELL, ["parameters"], "metric")
    parts = [
        frames["intervals"].assign(of="tables", recency="all"),
        frames["recency"].assign(of="recency"),
        frames["obstacles"].rename(columns={"last_hit": "recency"}).assign(of="obstacles"),
        _uncertain(frames["reliability"]).assign(of="uncertain", recency="all"),
        cost.assign(of="cost", recency="all"),
    ]
    rows = pd.concat(parts, ignore_index=True)
    columns = [*CELL, "of", "recency", "metric", "value", "low", "high"]
    return rows.assign(experiment=rows["experiment"].astype(str))[columns]


def _uncertain(diagrams: pd.DataFrame) -> pd.DataFrame:
    """Return calibration error and Brier skill where each cell is uncertain, over all its pixels."""
    rows = []
    for cell, bins in diagrams[diagrams["recency"] == "all"].groupby(CELL):
        diagram = Reliability(*(bins[name].to_numpy() for name in Reliability.__annotations__))
        measured = {"error": uncertain_error(diagram), "skill": uncertain_skill(diagram)}
        rows += [{**dict(zip(CELL, cell, strict=True)), "metric": name, "value": v} for name, v in measured.items()]
    return pd.DataFrame(rows, columns=[*CELL, "metric", "value"])
