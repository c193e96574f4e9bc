import numpy as np
import pytest

from repro.metrics.bootstrap import Measured, bounds, by_world, differences, draw_weights, intervals, resample


def measured(shares, worlds=200, pixels=400, seed=0):
    """Networks that call a share of the free pixels free in each world, a seed each."""
    rng = np.random.default_rng(seed)
    counts = np.zeros((len(shares), worlds, 2, 256), dtype=np.int64)
    hard = rng.normal(0, 0.05, worlds)  # some worlds are harder, for all seeds alike
    for number, share in enumerate(shares):
        right = rng.binomial(pixels, (share + hard).clip(0, 1))
        counts[number, :, 1, 255], counts[number, :, 1, 0] = right, pixels - right
        counts[number, :, 0, 0] = 50
    return Measured(counts, {"ssim": np.full((len(shares), worlds), 0.5)})


def value_of(table, metric):
    return vars(next(row for row in table if row.metric == metric))


def test_the_first_row_is_the_measured_value():
    one = measured([0.8])
    drawn = resample(one, draw_weights(200))
    assert drawn["recall"][0] == pytest.approx(one.counts[0, :, 1, 255].sum() / one.counts[0, :, 1].sum(), abs=1e-6)
    assert drawn["specificity"][0] == pytest.approx(1)
    assert len(drawn["recall"]) == 2001


def test_intervals_have_their_nominal_coverage():
    covered = 0
    for trial in range(200):
        row = value_of(
            intervals(resample(measured([0.8], worlds=60, seed=trial), draw_weights(60, draws=400))), "recall"
        )
        covered += row["low"] <= 0.8 <= row["high"]
    assert 0.88 <= covered / 200 <= 0.99


def test_a_paired_difference_is_narrower_than_its_parts():
    weights = draw_weights(200)
    one, other = (resample(measured([share]), weights) for share in (0.80, 0.79))
    row = value_of(differences(one, other), "recall")
    alone = value_of(intervals(one), "recall")
    assert row["excludes_zero"]
    assert row["high"] - row["low"] < 0.6 * (alone["high"] - alone["low"])
    assert not value_of(differences(one, one), "recall")["excludes_zero"]


def test_differing_seeds_widen_the_intervals():
    weights = draw_weights(200)
    same, apart = (value_of(intervals(resample(measured(s), weights)), "recall") for s in ([0.8] * 3, [0.7, 0.8, 0.9]))
    assert apart["value"] == pytest.approx(same["value"], abs=0.01)
    assert apart["high"] - apart["low"] > 2 * (same["high"] - same["low"])


def test_a_world_and_its_twin_are_summed():
    values = np.arange(12).reshape(6, 2)
    assert by_world(values).tolist() == [[2, 4], [10, 12], [18, 20]]


@pytest.mark.parametrize(("undefined", "high"), [(0, 0.975), (49, 0.975), (50, np.inf), (51, np.nan)])
def test_undefined_draws_are_above_all_others(undefined, high):
    drawn = np.linspace(0, 1, 2001)
    drawn[2001 - undefined :] = np.nan
    found = bounds(drawn)
    assert found[0] == pytest.approx(0.025, abs=1e-3)
    assert found[1] == pytest.approx(high, abs=1e-3, nan_ok=True)
