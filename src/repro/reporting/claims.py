"""Claims: tests of the paper's statements on the paper's numbers and on ours.

reproduce/claims.yaml lists every checkable statement with the expression that tests it. The `uncertainties` library
propagates the intervals of the numbers through the expression as independent standard errors. This is conservative for
differences of positively correlated numbers, as of two networks on the same test worlds; for recall and specificity or
precision, which are negatively correlated over seeds, the part due to the seeds is up to a third too small. A
difference counts only if it exceeds the tolerance and its interval excludes zero.
"""

import dataclasses
import enum
import itertools
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import Field
from uncertainties import nominal_value, std_dev

from repro.config import choice
from repro.reporting.expressions import Names, evaluate
from repro.reporting.numbers import Number, Numbers, Z, paper_rows
from repro.system.errors import InputError
from repro.system.files import read_typed

COLUMNS = (
    *("id", "quote", "place", "means", "verdict", "ours", "paper", "value", "low", "high", "claimed", "margin", "held"),
    *("combinations", "paper_value", "tolerance", "at_half", "at_double", "tolerance_from", "reason"),
)
ROUNDING = 1e-4  # rounding error of a difference of two numbers with four decimals


class Verdict(enum.StrEnum):
    """The result of the test of a claim."""

    reproduced = "reproduced"
    in_direction = "reproduced in direction"
    not_reproduced = "not reproduced"
    fails_in_paper = "fails on the paper's tables"
    untested = "cannot be tested"


@dataclass(frozen=True)
class Claim:
    """One statement of the paper; the header of claims.yaml explains the fields."""

    id: str
    quote: str
    place: str
    means: str = ""
    untestable: str | None = None
    test: str = ""
    over: Annotated[dict[str, list[Any]], Field(alias="for")] = field(default_factory=dict)
    claimed: float | str = 0.0
    expect: Annotated[str, choice("above", "near")] = "above"
    most: bool = False
    directed: bool = True
    tolerance: float | str = 0.0
    paper_tolerance: float = ROUNDING
    tolerance_from: str = ""


@dataclass(frozen=True)
class Ledger:
    """The content of claims.yaml."""

    tolerances: dict[str, dict[str, float]]
    claims: list[Claim]


def read_claims(path: Path) -> Ledger:
    """Read claims.yaml.

    Raises:
        ValueError: the file cannot be read, or a claim has neither or both of a test and a reason why it has none, or a
            tolerance that is not in the file.
    """
    ledger = read_typed(Ledger, path, "correct it")
    for claim in ledger.claims:
        by_metric = ledger.tolerances.get(claim.tolerance, {}) if isinstance(claim.tolerance, str) else None
        if by_metric is not None and not by_metric.keys() >= set(claim.over.get("metric", [None])):
            raise InputError(f"{path}: {claim.id} has the tolerance {claim.tolerance} without values for its metrics")
        if bool(claim.test) == bool(claim.untestable):
            raise InputError(f"{path}: {claim.id} needs either a test or a reason why it is untestable")
    return ledger


def judge(ledger: Ledger, ours: pd.DataFrame, paper: pd.DataFrame | None = None) -> pd.DataFrame:
    """Judge every claim, on the paper's own numbers and on ours.

    Args:
        ledger: see `read_claims`.
        ours: see `numbers.analysis_rows`.
        paper: see `numbers.paper_rows`.

    Returns:
        one row per claim: id, quote, place, means, verdict, ours (the verdict on our numbers alone), paper (holds,
        fails or no number), value of the decisive combination (the one closest to failing) with low and high, claimed,
        margin (its distance from failing), held and combinations (numbers of combinations that pass and of all),
        paper_value, tolerance, at_half and at_double (the verdict on our numbers at half and double the tolerance),
        tolerance_from; reason, why a claim is untestable. Without any number of ours no row: nothing is judged.

    Raises:
        ValueError: a test is no expression, or names an unknown table, metric, model or recency.
    """
    if ours.empty:
        return pd.DataFrame(columns=COLUMNS)
    papers = paper_rows() if paper is None else paper
    our_numbers, paper_numbers = (Numbers(rows, {*ours["model"], *papers["model"]}) for rows in (ours, papers))
    rows = [_judge_one(claim, ledger.tolerances, our_numbers, paper_numbers) for claim in ledger.claims]
    return pd.DataFrame(rows)


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
    """The test of one combination: the value, the claimed value and the tolerance."""

    value: float
    error: float  # standard error of the value
    claimed: float
    tolerance: float
    has_direction: bool  # an absolute value and a count have none

    def margin(self, expect: str) -> float:
        """Return the distance from failing, negative if the test fails."""
        gap = self.value - self.claimed
        return self.tolerance - abs(gap) if expect == "near" else gap - self.tolerance

    def holds(self, expect: str, slack: float = 1e-12) -> bool:
        """Return whether the test passes, by more than its interval and its tolerance."""
        significant = expect == "near" or self.value - self.claimed > Z * self.error - slack
        return significant and self.margin(expect) >= -slack

    def points(self, expect: str) -> bool:
        """Return whether the value has the claimed direction, regardless of its size."""
        if not self.has_direction:
            return False
        return self.value * self.claimed > 0 if expect == "near" else self.value > self.claimed


def _judge_one(claim: Claim, tolerances: dict, ours: Numbers, papers: Numbers) -> dict[str, Any]:
    row: dict[str, Any] = {"id": claim.id, "quote": claim.quote, "place": claim.place, "means": claim.means}
    if claim.untestable:
        return {**row, "verdict": Verdict.untested, "ours": Verdict.untested, "reason": claim.untestable}
    paper = _test(claim, tolerances, papers, papers, on_paper=True)
    holds = "no number" if paper is None else "holds" if _verdict(claim, paper) is Verdict.reproduced else "fails"
    row |= {"paper": holds, "paper_value": _worst(claim, paper).value if paper and claim.claimed != "paper" else None}
    tested = _test(claim, tolerances, ours, papers)
    verdict = Verdict.untested if tested is None else _verdict(claim, tested)
    if tested:
        worst = _worst(claim, tested)
        half = Z * worst.error if worst.error else float("nan")  # some quantities have no interval
        row |= {"value": worst.value, "low": worst.value - half, "high": worst.value + half}
        row |= {"claimed": worst.claimed, "tolerance": worst.tolerance, "margin": worst.margin(claim.expect)}
        row |= {"held": sum(each.holds(claim.expect) for each in tested), "combinations": len(tested)}
        row |= {"at_half": _verdict(claim, _scaled(tested, 0.5)), "at_double": _verdict(claim, _scaled(tested, 2))}
    final = Verdict.fails_in_paper if holds == "fails" else verdict
    return {**row, "verdict": final, "ours": verdict, "tolerance_from": claim.tolerance_from}


def _test(
    claim: Claim, tolerances: dict, rows: Numbers, papers: Numbers, *, on_paper: bool = False
) -> list[_Tested] | None:
    """Compute the test of every combination; None if a number is missing."""
    tested = []
    for values in itertools.product(*claim.over.values()):
        names = dict(zip(claim.over, values, strict=True))
        try:
            value, claimed = _evaluate(claim, rows, names), claim.claimed
            if claimed == "paper":
                claimed = nominal_value(_evaluate(claim, papers, names))
        except KeyError:
            return None
        given = claim.tolerance
        tolerance = tolerances[given][names["metric"]] if isinstance(given, str) else given
        allowed = claim.paper_tolerance if on_paper else tolerance
        has_direction = claim.directed and claim.claimed != "paper"
        tested.append(_Tested(nominal_value(value), std_dev(value), float(claimed), allowed, has_direction))
    return tested


def _evaluate(claim: Claim, rows: Numbers, values: dict[str, Any]) -> Number:
    """Evaluate the test of a claim; KeyError where a number is missing."""
    try:
        return evaluate(claim.test, Names({**values, "networks": rows.networks}, {"m": rows.m}))
    except (ValueError, TypeError, ArithmeticError, IndexError) as error:
        raise InputError(f"claims.yaml: the test of {claim.id}, {claim.test.strip()!r}, fails: {error}") from error


def _verdict(claim: Claim, tested: list[_Tested]) -> Verdict:
    required = len(tested) // 2 + 1 if claim.most else len(tested)
    if sum(each.holds(claim.expect) for each in tested) >= required:
        return Verdict.reproduced
    if sum(each.points(claim.expect) for each in tested) >= required:
        return Verdict.in_direction
    return Verdict.not_reproduced


def _worst(claim: Claim, tested: list[_Tested]) -> _Tested:
    """Return the decisive combination: the one closest to failing, or the median one if most have to pass."""
    ordered = sorted(tested, key=lambda each: each.margin(claim.expect))
    return ordered[(len(ordered) - 1) // 2 if claim.most else 0]


def _scaled(tested: list[_Tested], factor: float) -> list[_Tested]:
    return [dataclasses.replace(each, tolerance=factor * each.tolerance) for each in tested]
