from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from scipy.special import entr

from repro.metrics.headings import METRICS
from repro.reporting.claims import COLUMNS, Claim, Numbers, Verdict, count_verdicts, judge, on_paper
from repro.reporting.page import render
from repro.reporting.paper import free_share, paper_rows, read_paper
from repro.reporting.papers_claims import CLAIMS, analysis_rows, verdicts
from repro.reporting.results import read_frames, read_published
from repro.runs.model import NETWORKS

KEYS = {"of": "tables", "encoding": "projection", "recency": "all", "low": np.nan, "high": np.nan}
DRIVEN = "reliability-of-autonomous-systems"
NO_QUALITY = (
    "square-sees-more",
    "square-delays-more",
    "statistics-scale-badly",
    "stack-is-larger",
    "eight-variations",
    DRIVEN,
)  # of data, size, count
SCALES = ("workstation", "laptop")


def rows_of(**accuracy):
    """Rows of the average's accuracy by experiment (e3=0.9), or with an interval (e3=(0.9, 0.8, 1.0))."""
    rows = []
    for name, found in accuracy.items():
        value, low, high = found if isinstance(found, tuple) else (found, np.nan, np.nan)
        place = {"experiment": name[1:], "model": "average", "metric": "accuracy"}
        rows.append({**KEYS, **place, "value": value, "low": low, "high": high})
    return pd.DataFrame(rows)


def claim(test, over=None, **options):
    return Claim("one", test, over or {}, **options)


def verdict(claim, ours, paper=None):
    return judge([claim], ours, paper if paper is not None else rows_of(e3=0.95, e4=0.9)).iloc[0]


def difference(n):
    return n.table("accuracy", "3") - n.table("accuracy", "4")


ABOVE = claim(difference, tolerance=0.02)
LEVEL = claim(lambda n: n.table("accuracy", "3"), claimed="paper", near=True, tolerance=0.01)
DROP = claim(difference, claimed=0.05, near=True, tolerance=0.01)


@pytest.mark.parametrize(
    ("tested", "ours", "expected"),
    [
        (ABOVE, rows_of(e3=0.95, e4=0.90), Verdict.reproduced),
        (ABOVE, rows_of(e3=0.91, e4=0.90), Verdict.in_direction),
        (ABOVE, rows_of(e3=0.89, e4=0.90), Verdict.not_reproduced),
        (ABOVE, rows_of(e3=(0.95, 0.85, 1.05), e4=0.90), Verdict.in_direction),  # its interval does not leave out zero
        (ABOVE, rows_of(e3=(0.95, 0.94, 0.96), e4=(0.9, 0.89, 0.91)), Verdict.reproduced),
        (ABOVE, rows_of(e3=0.95), Verdict.untested),
        (LEVEL, rows_of(e3=0.955), Verdict.reproduced),
        (LEVEL, rows_of(e3=(0.955, 0.951, 0.959)), Verdict.reproduced),
        (LEVEL, rows_of(e3=(0.955, 0.949, 0.961)), Verdict.undecided),
        (LEVEL, rows_of(e3=(0.965, 0.959, 0.971)), Verdict.undecided),
        (LEVEL, rows_of(e3=(0.965, 0.961, 0.969)), Verdict.not_reproduced),
        (LEVEL, rows_of(e3=0.97), Verdict.not_reproduced),  # a level has no direction, but a difference does
        (DROP, rows_of(e3=0.92, e4=0.9), Verdict.in_direction),
        (DROP, rows_of(e3=(0.94, 0.93, 0.95), e4=0.9), Verdict.undecided),
    ],
)
def test_verdicts_follow_from_the_tolerance_and_the_interval(tested, ours, expected):
    assert verdict(tested, ours)["ours"] is expected


def test_a_verdict_has_those_at_half_and_double_the_tolerance_and_on_the_paper():
    row = verdict(ABOVE, rows_of(e3=0.93, e4=0.90))
    found = [row["at_half"], row["verdict"], row["at_double"]]
    assert found == [Verdict.reproduced, Verdict.reproduced, Verdict.in_direction]
    assert row["margin"] == pytest.approx(0.01)
    assert row[["low", "high"]].isna().all()  # as its numbers have no intervals
    row = verdict(ABOVE, rows_of(e3=0.95, e4=0.90), rows_of(e3=0.9, e4=0.95))
    assert (row["verdict"], row["ours"]) == (Verdict.fails_in_paper, Verdict.reproduced)


def test_all_combinations_must_hold_or_most_if_the_claim_says_so():
    ours, paper = rows_of(e1=0.9, e2=0.9, e3=0.5), rows_of(e1=0.9, e2=0.9, e3=0.9)
    over = {"exp": ["1", "2", "3"], "metric": ["accuracy"]}
    for most, expected in ((False, Verdict.not_reproduced), (True, Verdict.reproduced)):
        judged = claim(lambda n, exp, metric: n.table(metric, exp) - 0.8, over, most=most, tolerance={"accuracy": 0.01})
        row = verdict(judged, ours, paper)
        assert (row["verdict"], row["held"], row["combinations"]) == (expected, 2, 3)
    assert row["value"] == pytest.approx(0.1)  # the median one


def test_nothing_is_judged_on_worlds_that_are_not_the_papers():
    claims = judge(CLAIMS, rows_of(e3=0.9).iloc[:0])
    assert claims.empty
    assert list(claims.columns) == list(judge(CLAIMS, paper_rows()).columns)
    assert count_verdicts(claims) == ""
    frames, results = analysis("laptop"), read_published(ROOT / "reproduce" / "results" / "laptop")
    assert (
        verdicts(frames, results.assign(papers_worlds=results["experiment"] != "3"))["verdict"].eq("reproduced").any()
    )
    none = verdicts(frames, results.assign(papers_worlds=False))
    assert none.empty
    assert list(none.columns) == list(COLUMNS)
    for claims, number in ((frames["claims"], 1), (none, 0)):
        page = render(Path("laptop"), results, {**frames, "claims": claims}, {})
        assert page.count('<section id="claims">') == number
        assert ('href="#claims"' in page) == bool(number)


def test_verdicts_are_counted_in_the_order_from_reproduced_to_untested():
    counts = {Verdict.untested: 3, Verdict.fails_in_paper: 7, Verdict.in_direction: 1, Verdict.reproduced: 17}
    found = [verdict for verdict, count in counts.items() for _ in range(count)]
    expected = "17 reproduced, 1 reproduced in direction, 7 fail on the paper's own tables, 3 cannot be tested"
    assert count_verdicts(pd.DataFrame({"verdict": found})) == expected


def analysis(scale):
    return read_frames(ROOT / "reproduce" / "results" / scale)


@pytest.mark.parametrize("scale", SCALES)
def test_the_published_verdicts_follow_from_the_published_tables(scale):
    frames = {**analysis(scale), **{name: analysis(name)[name] for name in ("navigation", "scaling")}}
    found = verdicts(frames, read_published(ROOT / "reproduce" / "results" / scale))
    assert found[["quote", "place"]].notna().all(axis=None)
    assert found["verdict"].tolist() == frames["claims"]["verdict"].tolist()
    is_tested = [claim.test is not None for claim in CLAIMS]  # a misspelled name would leave a claim untested
    assert found["ours"].ne(Verdict.untested).tolist() == is_tested
    assert found.loc[is_tested, ["means", "tolerance_from"]].notna().all(axis=None)


def trivial(frames, constant):
    """Replace the predictions of all networks by free space everywhere, or by the share of obstacles everywhere.

    The thresholded predictions are equal; the SSIM of the constant, which is not published, is taken to be that of
    free space.
    """
    frames = dict(frames)
    free = frames["recency"].query("model == 'all_free' and recency == 'all' and metric == 'obstacle_share'")
    share = free.set_index("experiment")["value"]
    for name in ("intervals", "recency", "obstacles"):
        rows = frames[name]
        own = rows[rows["model"] == "all_free"].drop(columns=["model", "encoding"])
        cells = rows[["experiment", "model", "encoding"]].drop_duplicates()
        frames[name] = cells.merge(own, on="experiment")
    entropy = frames["recency"]["metric"] == "entropy"
    if constant:
        everywhere = frames["recency"]["experiment"].map(entr(share) + entr(1 - share))
        frames["recency"] = frames["recency"].assign(value=frames["recency"]["value"].where(~entropy, everywhere))
    cells = frames["reliability"][["experiment", "model", "encoding"]].drop_duplicates()
    observed = cells["experiment"].map(share)
    low, high = (1 / 15, 2 / 15) if constant else (0, 1 / 15)  # the bin of the prediction
    frames["reliability"] = cells.assign(
        low=low, high=high, predicted=observed if constant else 0.0, observed=observed, pixels=1000, recency="all"
    )
    return frames


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("constant", [False, True], ids=["all free", "constant"])
def test_every_claim_of_quality_fails_for_a_trivial_prediction(constant, scale):
    of_quality = [claim for claim in CLAIMS if claim.test and claim.id not in NO_QUALITY]
    found = judge(of_quality, analysis_rows(trivial(analysis(scale), constant))).set_index("id")["ours"]
    if not constant:  # never uncertain
        assert found.pop("probabilities-are-learned") in (Verdict.not_reproduced, Verdict.untested)
    assert found[found != Verdict.not_reproduced].empty


@pytest.mark.parametrize(
    ("low", "expected"), [(0.01, Verdict.reproduced), (-0.01, Verdict.in_direction), (None, Verdict.untested)]
)
def test_robots_are_more_reliable_if_the_interval_of_their_gain_is_above_zero(low, expected):
    frames = analysis("laptop")
    frames.pop("navigation", None)
    if low is not None:
        mappers = {"mapper": ["keep", "unet-projection"], "difference": [0.0, 0.05]}
        others = {"experiment": "all", "difference_low": [0, low], "difference_high": [0, 0.1 - low]}
        frames["navigation"] = pd.DataFrame({**mappers, **others})
    found = verdicts(frames, read_published(ROOT / "reproduce" / "results" / "laptop")).set_index("id")
    assert found.loc[DRIVEN, "verdict"] == expected


def test_the_papers_errors_are_found_on_its_own_numbers():
    """Compare with the errors of the paper that DEVIATIONS lists, from its tables only."""
    table = judge(CLAIMS, paper_rows()).set_index("id")
    slips = table.index[table["paper"] == "fails"].tolist()
    assert slips == [
        "boundaries-stretch",  # recall exceeds precision, and free is the positive class
        "decay-costs-one-or-two-percent",
        "eight-variations",
    ]
    assert table.loc["decay-costs-nine-percent", "paper_value"] == pytest.approx(9.365)  # a median
    assert table.loc["decay-costs-twelve-percent", "paper_value"] == pytest.approx(11.995)
    lost = read_paper().query("model == 'average'").pivot(index="experiment", columns="encoding", values="specificity")
    drops = 100 * (lost["projection"] - lost["projection-no-decay"]).loc[["3", "4"]]
    assert drops.tolist() == pytest.approx([8.17, 13.98])
    assert (table.loc[table["paper"] == "holds", "ours"] == Verdict.reproduced).sum() >= 6
    assert on_paper(table.loc["eight-variations"]) == "fails, 4.000"
    assert on_paper(table.loc["accuracy-level"]) == "holds"  # close to itself, in every combination
    assert on_paper(table.loc["stack-is-larger"]) == ""  # the paper has no number


def test_the_papers_tables_agree_only_if_free_is_the_positive_class():
    """The share of free pixels follows twice from every row, and Dice from precision and recall, up to rounding."""
    table = read_paper()
    p, r, s, dice = (table[name] for name in ("precision", "recall", "specificity", "dice"))
    by_precision = p * (1 - s) / (p * (1 - s) + r * (1 - p))
    assert (free_share(table) - by_precision).abs().max() < 5e-3
    assert (2 * p * r / (p + r) - dice).abs().max() < 1.01e-4
    share = free_share(table)
    iou = (1 - share) * s / (1 - share + share * (1 - r))  # of obstacles, in docs/results.md
    assert iou[table["model"] == "average"].round(3).tolist() == [0.772, 0.848, 0.472, 0.475, 0.388, 0.352]
    swapped = table.assign(recall=s, specificity=r)  # as if obstacles were the positive class
    assert (free_share(swapped) - p * (1 - r) / (p * (1 - r) + s * (1 - p))).abs().min() > 0.1


def test_the_papers_rows_include_the_scores_of_all_free():
    rows = Numbers(paper_rows())
    assert rows.table("accuracy", "3", "all_free") == pytest.approx(0.9164, abs=1e-3)
    assert rows.table("accuracy", ["1", "3"]) == pytest.approx((0.9755 + 0.9487) / 2)
    assert rows.networks == 4
    with pytest.raises(KeyError):
        rows.table("accuracy", "7")
    assert set(paper_rows()["metric"]) == set(METRICS)


def test_at_256_px_three_verdicts_are_worse_than_at_128_px():
    """Compare with docs/results.md: one seed without intervals, so levels and differences count by their values."""
    rows = read_published(ROOT / "reproduce" / "results" / "workstation256")
    networks = rows[rows["model"].isin(NETWORKS)]
    average = networks.groupby(["experiment", "encoding"])[[*METRICS]].mean().reset_index().assign(model="average")
    cells = pd.concat([networks, average, rows[rows["model"] == "all_free"]])
    long = cells.melt(["experiment", "model", "encoding"], [*METRICS], "metric")
    found = judge(CLAIMS, long.assign(of="tables", recency="all", low=np.nan, high=np.nan)).set_index("id")
    level = found.loc[["accuracy-level", "specificity-level", "ssim-level"]]
    assert level["ours"].eq(Verdict.not_reproduced).all()
    assert level["margin"].round(4).tolist()[:1] == [-0.0001]
    assert (level["combinations"] - level["held"]).tolist() == [1, 3, 6]
    assert found.loc["decay-helps", "ours"] == Verdict.not_reproduced
