"""The answer of a study: its distance from the paper and the paper's two effects."""

import pandas as pd
import pytest

from repro.reporting.answer import answer, beside_paper, decay_table, effects, effects_line
from repro.reporting.paper import read_paper
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.model import NETWORKS


def results(lower: float = 0.0, encodings=(PROJECTION, PROJECTION_NO_DECAY)) -> pd.DataFrame:
    """Return the paper's own tables as results of two seeds, with a lower specificity without decay."""
    rows = read_paper()
    rows = rows[rows["model"].isin(NETWORKS) & rows["encoding"].isin(encodings)].assign(papers_worlds=True)
    rows.loc[rows["encoding"] == PROJECTION_NO_DECAY, "specificity"] -= lower
    apart = pd.Series([0.01, 0.01], ["accuracy", "specificity"])
    first, second = (rows.assign(seed=seed) for seed in (0, 1))
    first[apart.index], second[apart.index] = first[apart.index] + apart, second[apart.index] - apart
    return pd.concat([first, second], ignore_index=True)


def test_the_papers_own_tables_have_no_distance_and_its_effects():
    sentences = answer(results())
    assert sentences[0].replace("-0.000", "+0.000").count("+0.000") == 3
    changes = {effect.name: (effect.ours, effect.paper) for effect in effects(beside_paper(results()))}
    paper = read_paper().query("model == 'average'").set_index(["experiment", "encoding"])["specificity"]
    without = (paper["3", PROJECTION_NO_DECAY] + paper["4", PROJECTION_NO_DECAY]) / 2
    moving, still = ((paper[one, PROJECTION] + paper[two, PROJECTION]) / 2 for one, two in (("3", "4"), ("1", "2")))
    assert changes["Without the time decay"] == pytest.approx((without - moving,) * 2, abs=1e-3)
    assert changes["Where obstacles move"] == pytest.approx((moving - still,) * 2, abs=1e-3)
    assert sentences[-1].startswith("Without the time decay, the networks find on average ")
    assert f"(paper: {100 * (moving - without):.1f} fewer)" in sentences[-1]


def test_one_network_is_named():
    one = results().query("model == 'unet' and experiment in ('1', '3')")
    sentences = answer(one)
    assert sentences[0].endswith("(3 trained networks).")
    assert [sentence.split(" finds")[0] for sentence in sentences[2:]] == [
        "Where obstacles move, U-Net",
        "Without the time decay, U-Net",
    ]


def test_the_effect_of_the_decay_is_shown_for_each_network_with_both_runs():
    table = decay_table(results(lower=0.1))
    assert [row[:2] for row in table.rows[:5]] == [
        ("3", name) for name in ("U-Net", "FPN", "UPerNet", "Segformer", "Average")
    ]
    paper = read_paper().set_index(["experiment", "model", "encoding"])["specificity"]
    usual, without = paper["3", "unet", PROJECTION], paper["3", "unet", PROJECTION_NO_DECAY]
    assert table.rows[0][2:] == (
        f"{usual:.3f} ({usual:.3f})",
        f"{without - 0.1:.3f} ({without:.3f})",
        f"{usual - without + 0.1:.3f} ({usual - without:.3f})",
    )
    assert "without the time decay -0.21 (paper -0.11)" in effects_line(results(lower=0.1))


def test_runs_of_other_worlds_or_without_a_counterpart_have_no_effect():
    only = results(encodings=(PROJECTION_NO_DECAY,))
    assert not decay_table(only).rows
    assert effects_line(only) == ""
    assert answer(pd.DataFrame()) == answer(results().assign(papers_worlds=False)) == []
