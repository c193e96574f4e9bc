"""Claims: whether what the paper says holds, on its own numbers and on ours.

reproduce/claims.yaml has every checkable statement with the expression that tests it. Numbers carry their intervals
through the expression (by the `uncertainties` library, as independent standard errors, which is conservative for
differences on the same test worlds); a difference counts only where it is larger than the tolerance and its interval
leaves out zero.
"""

import dataclasses
import enum
import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import Field
from uncertainties import nominal_value, std_dev

from repro.config import choice
from repro.reporting.numbers import Number, Numbers, Z, paper_rows
from repro.system.files import read_typed

ROUNDING = 1e-4  # a difference of two numbers of four digits


class Verdict(enum.StrEnum):
    """What became of a claim."""

    reproduced = "reproduced"
    in_direction = "reproduced in direction"
    not_reproduced = "not reproduced"
    contradicts = "paper contradicts itself"
    untested = "cannot be tested at this scale"


@dataclass(frozen=True)
class Claim:
    """One statement of the paper; see the head of claims.yaml."""

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
    tolerance: float | str = 0.0
    paper_tolerance: float = ROUNDING
    tolerance_from: str = ""


@dataclass(frozen=True)
class Ledger:
    """What claims.yaml holds."""

    tolerances: dict[str, dict[str, float]]
    claims: list[Claim]


def read_claims(path: Path) -> Ledger:
    """Reads the ledger.

    Raises:
        ValueError: it cannot be read, or a claim has no test and no reason why.
    """
    ledger = read_typed(Ledger, path, "mend it")
    for claim in ledger.claims:
        if bool(claim.test) == bool(claim.untestable):
            raise ValueError(f"{path}: {claim.id} needs either a test or a reason why there can be none")
    return ledger


def judge(ledger: Ledger, ours: pd.DataFrame, paper: pd.DataFrame | None = None) -> pd.DataFrame:
    """Judges every claim, on the paper's own numbers and on ours.

    Args:
        ledger: see `read_claims`.
        ours: see `numbers.analysis_rows`.
        paper: see `numbers.paper_rows`.

    Returns:
        one row a claim: id, quote, place, means, verdict, ours (the verdict on our numbers alone), paper (holds, fails,
        or no number), value (of the combination that is nearest to failing), low, high, claimed, margin (how far it is
        from failing), held and combinations, paper_value, tolerance, at_half and at_double (the verdict on ours at half
        and double the tolerance), tolerance_from.
    """
    own, theirs = Numbers(ours), Numbers(paper_rows() if paper is None else paper)
    return pd.DataFrame([_judge_one(claim, ledger.tolerances, own, theirs) for claim in ledger.claims])


@dataclass(frozen=True)
class _Tested:
    """A test of one combination: what came out, what was claimed, and by how much it may be off."""

    value: float
    error: float  # its standard error
    claimed: float
    tolerance: float
    is_level: bool  # the claim is a level, which has no direction

    def margin(self, expect: str) -> float:
        """How far it is from failing; negative when it fails."""
        gap = self.value - self.claimed
        return self.tolerance - abs(gap) if expect == "near" else gap - self.tolerance

    def holds(self, expect: str, slack: float = 1e-12) -> bool:
        clear = expect == "near" or self.value - self.claimed > Z * self.error - slack
        return clear and self.margin(expect) >= -slack

    def points(self, expect: str) -> bool:
        """Whether it has the direction claimed, whatever its size."""
        if self.is_level:
            return False
        return self.value * self.claimed > 0 if expect == "near" else self.value > self.claimed


def _judge_one(claim: Claim, tolerances: dict, own: Numbers, theirs: Numbers) -> dict[str, Any]:
    row: dict[str, Any] = {"id": claim.id, "quote": claim.quote, "place": claim.place, "means": claim.means}
    if claim.untestable:
        return {**row, "verdict": Verdict.untested, "ours": Verdict.untested, "reason": claim.untestable}
    paper = _test(claim, tolerances, theirs, theirs, on_paper=True)
    holds = "no number" if paper is None else "holds" if _verdict(claim, paper) is Verdict.reproduced else "fails"
    row |= {"paper": holds, "paper_value": _worst(claim, paper).value if paper else None}
    tested = _test(claim, tolerances, own, theirs)
    verdict = Verdict.untested if tested is None else _verdict(claim, tested)
    if tested:
        worst = _worst(claim, tested)
        half = Z * worst.error
        row |= {"value": worst.value, "low": worst.value - half, "high": worst.value + half}
        row |= {"claimed": worst.claimed, "tolerance": worst.tolerance, "margin": worst.margin(claim.expect)}
        row |= {"held": sum(each.holds(claim.expect) for each in tested), "combinations": len(tested)}
        row |= {"at_half": _verdict(claim, _scaled(tested, 0.5)), "at_double": _verdict(claim, _scaled(tested, 2))}
    final = Verdict.contradicts if holds == "fails" else verdict
    return {**row, "verdict": final, "ours": verdict, "tolerance_from": claim.tolerance_from}


def _test(
    claim: Claim, tolerances: dict, rows: Numbers, theirs: Numbers, *, on_paper: bool = False
) -> list[_Tested] | None:
    """Computes the test of every combination; None where a number is missing."""
    found = []
    code = compile(claim.test.strip(), claim.id, "eval")
    for values in itertools.product(*claim.over.values()):
        names = dict(zip(claim.over, values, strict=True))
        try:
            value, claimed = _evaluate(code, rows, names), claim.claimed
            if claimed == "paper":
                claimed = nominal_value(_evaluate(code, theirs, names))
        except KeyError:
            return None
        known = claim.tolerance
        tolerance = tolerances[known][names["metric"]] if isinstance(known, str) else known
        allowed = claim.paper_tolerance if on_paper else tolerance
        found.append(_Tested(nominal_value(value), std_dev(value), float(claimed), allowed, claim.claimed == "paper"))
    return found


def _evaluate(code: Any, rows: Numbers, names: dict[str, Any]) -> Number:
    known = {"__builtins__": {}, "m": rows.m, "networks": rows.networks, **names}
    return eval(code, known)  # the code is claims.yaml's, which is the project's own


def _verdict(claim: Claim, tested: list[_Tested]) -> Verdict:
    need = len(tested) // 2 + 1 if claim.most else len(tested)
    if sum(each.holds(claim.expect) for each in tested) >= need:
        return Verdict.reproduced
    if sum(each.points(claim.expect) for each in tested) >= need:
        return Verdict.in_direction
    return Verdict.not_reproduced


def _worst(claim: Claim, tested: list[_Tested]) -> _Tested:
    """The combination that decides: the one nearest to failing, or where most will do the one in the middle."""
    ordered = sorted(tested, key=lambda each: each.margin(claim.expect))
    return ordered[(len(ordered) - 1) // 2 if claim.most else 0]


def _scaled(tested: list[_Tested], factor: float) -> list[_Tested]:
    return [dataclasses.replace(each, tolerance=factor * each.tolerance) for each in tested]
