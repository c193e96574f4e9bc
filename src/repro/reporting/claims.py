"""Claims: tests of the paper's statements on the paper's numbers and on ours, with their intervals.

`papers_claims.CLAIMS` lists the test of every checkable statement, paper_tables/claims.csv its words. The
`uncertainties` library propagates the intervals of the numbers through the test as independent standard errors. This is
conservative for differences of positively correlated numbers, as of two networks on the same test worlds; for recall
and specificity or precision, which are negatively correlated over seeds, the part due to the seeds is up to a third too
small. A difference counts only if it exceeds the tolerance and its interval excludes zero; a level counts only if its
whole interval is within the tolerance.
"""

import dataclasses
import enum
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import pandas as pd
from uncertainties import nominal_value, std_dev, ufloat

from repro.baselines.titles import BASELINES
from repro.reporting.paper import paper_rows
from repro.runs.config import PROJECTION
from repro.runs.keys import CELL
from repro.runs.model import NETWORKS

Z = 1.96  # half-width of a 95 % interval in standard errors
Number = Any  # a float, or a number of `uncertainties` with its standard error
COLUMNS = (
    *("id", "quote", "place", "means", "verdict", "ours", "paper", "value", "low", "high", "claimed", "margin", "held"),
    *("combinations", "paper_value", "tolerance", "at_half", "at_double", "tolerance_from", "reason"),
)
TEXTS = ("quote", "place", "means", "tolerance_from", "reason")  # columns of paper_tables/claims.csv
ROUNDING = 1e-4  # rounding error of a difference of two numbers with four decimals
SLACK = 1e-12  # error of the arithmetic


class Numbers:
    """Numbers by table, metric and cell; each method raises KeyError for a number that has not been measured.

    Args:
        rows: see `papers_claims.analysis_rows` and `paper.paper_rows`.
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
        encoding = "" if model in BASELINES else encoding
        return sum(self.numbers["tables", metric, e, model, encoding, "all"] for e in experiments) / len(experiments)

    def unet(self, of: str, metric: str, exp: str, group: str = "all", encoding: str = PROJECTION) -> Number:
        """Return a number of U-Net.

        Args:
            of: `recency` of pixels, `obstacles` by the time since their last hit, `uncertain` predictions, `cost`, or
                `navigation`.
            metric: the measure, of uncertain predictions `error` or `skill`, see `metrics.calibration`.
            exp: the experiment.
            group: the recency of the pixels, or the last hit of the obstacles.
            encoding: label of its encoding.
        """
        return self.numbers[of, metric, exp, "unet", encoding, group]


class Verdict(enum.StrEnum):
    """The result of the test of a claim."""

    reproduced = "reproduced"
    in_direction = "reproduced in direction"
    undecided = "undecided"
    not_reproduced = "not reproduced"
    fails_in_paper = "fails on the paper's tables"
    untested = "cannot be tested"


@dataclass(frozen=True)
class Claim:
    """The test of one statement of the paper.

    Args:
        id: its short name in paper_tables/claims.csv.
        test: returns the tested value of a combination from the numbers, for example `test(numbers, exp="3")`; None if
            the statement cannot be tested.
        over: the values of each argument of the test; every combination is tested.
        claimed: the value to exceed or to be close to; `paper` is the value of the paper's numbers.
        near: whether the value must be within the tolerance of `claimed`; else it must exceed it by the tolerance.
        most: whether more than half of the combinations must pass; else all must.
        directed: whether a value that misses has a direction that could hold.
        tolerance: one number, or one for each `metric`.
        paper_tolerance: tolerance for the paper's own numbers, which is rounding.
    """

    id: str
    test: Callable[..., Number] | None = None
    over: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    _: dataclasses.KW_ONLY
    claimed: float | Literal["paper"] = 0.0
    near: bool = False
    most: bool = False
    directed: bool = True
    tolerance: float | Mapping[str, float] = 0.0
    paper_tolerance: float = ROUNDING


def judge(claims: Iterable[Claim], ours: pd.DataFrame, paper: pd.DataFrame | None = None) -> pd.DataFrame:
    """Judge every claim, on the paper's own numbers and on ours.

    A claim whose test fails on the paper's numbers fails on the paper's tables, whatever ours say.

    Args:
        claims: the claims, `papers_claims.CLAIMS` in the study.
        ours: see `papers_claims.analysis_rows`.
        paper: see `paper.paper_rows`.

    Returns:
        one row per claim: id, verdict, ours (the verdict on our numbers alone), paper (holds, fails or no number),
        value of the decisive combination (the one closest to failing) with low and high, claimed, margin (its distance
        from failing), held and combinations (numbers of combinations that pass and of all), paper_value, tolerance,
        at_half and at_double (the verdict on our numbers at half and double the tolerance). Without any number of ours
        no row: nothing is judged.
    """
    columns = [name for name in COLUMNS if name not in TEXTS]
    if ours.empty:
        return pd.DataFrame(columns=columns)
    numbers, papers = Numbers(ours), Numbers(paper_rows() if paper is None else paper)
    return pd.DataFrame([_judge_one(claim, numbers, papers) for claim in claims], columns=columns)


def count_verdicts(claims: pd.DataFrame) -> str:
    """Return the number of claims of each verdict as text, `17 reproduced, 4 not reproduced`; see `judge`."""
    counts = claims["verdict"].value_counts()
    texts = {verdict: f"{counts[verdict]} {verdict}" for verdict in Verdict if verdict in counts}
    if failing := counts.get(Verdict.fails_in_paper, 0):
        verb = "fails" if failing == 1 else "fail"
        texts[Verdict.fails_in_paper] = f"{failing} {verb} on the paper's own tables"
    return ", ".join(texts.values())


def on_paper(claim: pd.Series) -> str:
    """Return whether a claim of `judge` holds on the paper's numbers, with its value if it has one; empty if untested.

    A claim that our numbers are close to the paper's has no value there.
    """
    if claim.get("paper") not in ("holds", "fails"):
        return ""
    value = claim["paper_value"]
    return claim["paper"] if pd.isna(value) else f"{claim['paper']}, {value:.3f}"


def _judge_one(claim: Claim, ours: Numbers, papers: Numbers) -> dict[str, Any]:
    row: dict[str, Any] = {"id": claim.id, "verdict": Verdict.untested, "ours": Verdict.untested}
    if claim.test is None:
        return row
    row["paper"] = "no number"
    if len(paper := _test(claim, papers, papers, claim.paper_tolerance)):
        row["paper"] = "holds" if _verdict(claim, paper) is Verdict.reproduced else "fails"
        row["paper_value"] = None if claim.claimed == "paper" else _worst(claim, paper)["value"]
    if len(tested := _test(claim, ours, papers)):
        worst = _worst(claim, tested)
        half = worst["half"] or float("nan")  # some quantities have no interval
        row |= {"ours": _verdict(claim, tested), "low": worst["value"] - half, "high": worst["value"] + half}
        row |= {name: worst[name] for name in ("value", "claimed", "tolerance", "margin")}
        row |= {"held": _passes(claim, tested)[Verdict.reproduced].sum(), "combinations": len(tested)}
        row |= {"at_half": _verdict(claim, tested, 0.5), "at_double": _verdict(claim, tested, 2)}
    return {**row, "verdict": Verdict.fails_in_paper if row["paper"] == "fails" else row["ours"]}


def _test(claim: Claim, rows: Numbers, papers: Numbers, tolerance: float | None = None) -> pd.DataFrame:
    """Compute the test of every combination, with another tolerance if one is given.

    Returns:
        value, half (of its interval), claimed, tolerance of each combination; empty if a number is missing.
    """
    assert claim.test is not None
    tested = []
    for values in itertools.product(*claim.over.values()):
        case = dict(zip(claim.over, values, strict=True))
        try:
            value = claim.test(rows, **case)
            claimed = nominal_value(claim.test(papers, **case)) if claim.claimed == "paper" else claim.claimed
        except KeyError:
            return pd.DataFrame()
        own = claim.tolerance if isinstance(claim.tolerance, float | int) else claim.tolerance[case["metric"]]
        row = (nominal_value(value), Z * std_dev(value), claimed, own if tolerance is None else tolerance)
        tested.append(tuple(map(float, row)))
    return pd.DataFrame(tested, columns=["value", "half", "claimed", "tolerance"])


def _margin(claim: Claim, tested: pd.DataFrame) -> pd.Series:
    """Return the distance of each combination from failing, negative if the test fails."""
    gap = tested["value"] - tested["claimed"]
    return tested["tolerance"] - gap.abs() - tested["half"] if claim.near else gap - tested["tolerance"]


def _passes(claim: Claim, tested: pd.DataFrame) -> dict[Verdict, pd.Series]:
    """Return which combinations pass for each verdict.

    A difference must exceed its interval and its tolerance. Of a level, a part of the interval may be within the
    tolerance. A value has the claimed direction regardless of its size; levels and counts have none.
    """
    gap, half, margin = tested["value"] - tested["claimed"], tested["half"], _margin(claim, tested)
    has_direction = claim.directed and claim.claimed != "paper"
    return {
        Verdict.reproduced: (margin >= -SLACK) & (claim.near | (gap > half - SLACK)),
        Verdict.undecided: (margin + 2 * half >= -SLACK) & claim.near,
        Verdict.in_direction: ((tested["value"] * tested["claimed"] if claim.near else gap) > 0) & has_direction,
    }


def _verdict(claim: Claim, tested: pd.DataFrame, factor: float = 1) -> Verdict:
    """Return the verdict with the tolerance times a factor."""
    passes = _passes(claim, tested.assign(tolerance=factor * tested["tolerance"]))
    required = len(tested) // 2 + 1 if claim.most else len(tested)
    return next((verdict for verdict, own in passes.items() if own.sum() >= required), Verdict.not_reproduced)


def _worst(claim: Claim, tested: pd.DataFrame) -> pd.Series:
    """Return the decisive combination: the one closest to failing, or the median one if most have to pass."""
    ordered = tested.assign(margin=_margin(claim, tested)).sort_values("margin", kind="stable")
    return ordered.iloc[(len(ordered) - 1) // 2 if claim.most else 0]
