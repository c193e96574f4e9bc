"""Claims: tests of the paper's statements on the paper's numbers and on ours.

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
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import pandas as pd
from uncertainties import nominal_value, std_dev

from repro.reporting.numbers import Number, Numbers, Z, paper_rows

COLUMNS = (
    *("id", "quote", "place", "means", "verdict", "ours", "paper", "value", "low", "high", "claimed", "margin", "held"),
    *("combinations", "paper_value", "tolerance", "at_half", "at_double", "tolerance_from", "reason"),
)
TEXTS = ("quote", "place", "means", "tolerance_from", "reason")  # columns of paper_tables/claims.csv
ROUNDING = 1e-4  # rounding error of a difference of two numbers with four decimals
SLACK = 1e-12  # error of the arithmetic


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
        ours: see `numbers.analysis_rows`.
        paper: see `numbers.paper_rows`.

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
    counts = Counter(claims["verdict"])
    words = {str(verdict): str(verdict) for verdict in Verdict}
    words[Verdict.fails_in_paper] = (
        f"{'fails' if counts[Verdict.fails_in_paper] == 1 else 'fail'} on the paper's own tables"
    )
    return ", ".join(f"{counts[verdict]} {text}" for verdict, text in words.items() if counts[verdict])


def on_paper(claim: pd.Series | Mapping[str, Any], precision: str) -> str:
    """Return whether a claim of `judge` holds on the paper's numbers, with its value if it has one; empty if untested.

    A claim that our numbers are close to the paper's has no value there.
    """
    if claim.get("paper") not in ("holds", "fails"):
        return ""
    value = claim["paper_value"]
    return claim["paper"] if pd.isna(value) else f"{claim['paper']}, {value:{precision}}"


@dataclass(frozen=True)
class _Tested:
    """The test of one combination: the value with half of its interval, the claimed value and the tolerance."""

    value: float
    half: float
    claimed: float
    tolerance: float

    def margin(self, claim: Claim) -> float:
        """Return the distance from failing, negative if the test fails."""
        gap = self.value - self.claimed
        return self.tolerance - abs(gap) - self.half if claim.near else gap - self.tolerance

    def holds(self, claim: Claim) -> bool:
        """Return whether the test passes, by more than its interval and its tolerance."""
        is_significant = claim.near or self.value - self.claimed > self.half - SLACK
        return is_significant and self.margin(claim) >= -SLACK

    def may_hold(self, claim: Claim) -> bool:
        """Return whether a part of the interval of a level is within the tolerance."""
        return claim.near and self.margin(claim) + 2 * self.half >= -SLACK

    def points(self, claim: Claim) -> bool:
        """Return whether the value has the claimed direction, regardless of its size; levels and counts have none."""
        if not claim.directed or claim.claimed == "paper":
            return False
        return self.value * self.claimed > 0 if claim.near else self.value > self.claimed


def _judge_one(claim: Claim, ours: Numbers, papers: Numbers) -> dict[str, Any]:
    row: dict[str, Any] = {"id": claim.id, "verdict": Verdict.untested, "ours": Verdict.untested}
    if claim.test is None:
        return row
    paper, tested = _test(claim, papers, papers, claim.paper_tolerance), _test(claim, ours, papers)
    holds = "no number" if not paper else "holds" if _verdict(claim, paper) is Verdict.reproduced else "fails"
    row |= {"paper": holds, "paper_value": _worst(claim, paper).value if paper and claim.claimed != "paper" else None}
    verdict = _verdict(claim, tested) if tested else Verdict.untested
    if tested:
        worst = _worst(claim, tested)
        half = worst.half or float("nan")  # some quantities have no interval
        row |= {"value": worst.value, "low": worst.value - half, "high": worst.value + half}
        row |= {"claimed": worst.claimed, "tolerance": worst.tolerance, "margin": worst.margin(claim)}
        row |= {"held": sum(each.holds(claim) for each in tested), "combinations": len(tested)}
        row |= {"at_half": _verdict(claim, _scaled(tested, 0.5)), "at_double": _verdict(claim, _scaled(tested, 2))}
    final = Verdict.fails_in_paper if holds == "fails" else verdict
    return {**row, "verdict": final, "ours": verdict}


def _test(claim: Claim, rows: Numbers, papers: Numbers, tolerance: float | None = None) -> list[_Tested]:
    """Compute the test of every combination, with another tolerance if one is given; empty if a number is missing."""
    assert claim.test is not None
    tested = []
    for values in itertools.product(*claim.over.values()):
        case = dict(zip(claim.over, values, strict=True))
        try:
            value = claim.test(rows, **case)
            claimed = nominal_value(claim.test(papers, **case)) if claim.claimed == "paper" else claim.claimed
        except KeyError:
            return []
        own = claim.tolerance if isinstance(claim.tolerance, float | int) else claim.tolerance[case["metric"]]
        allowed = own if tolerance is None else tolerance
        tested.append(_Tested(float(nominal_value(value)), Z * float(std_dev(value)), float(claimed), allowed))
    return tested


def _verdict(claim: Claim, tested: list[_Tested]) -> Verdict:
    required = len(tested) // 2 + 1 if claim.most else len(tested)
    for verdict, passes in {
        Verdict.reproduced: _Tested.holds,
        Verdict.undecided: _Tested.may_hold,
        Verdict.in_direction: _Tested.points,
    }.items():
        if sum(passes(each, claim) for each in tested) >= required:
            return verdict
    return Verdict.not_reproduced


def _worst(claim: Claim, tested: list[_Tested]) -> _Tested:
    """Return the decisive combination: the one closest to failing, or the median one if most have to pass."""
    ordered = sorted(tested, key=lambda each: each.margin(claim))
    return ordered[(len(ordered) - 1) // 2 if claim.most else 0]


def _scaled(tested: list[_Tested], factor: float) -> list[_Tested]:
    return [dataclasses.replace(each, tolerance=factor * each.tolerance) for each in tested]
