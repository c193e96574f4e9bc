import numpy as np
import pandas as pd
import pytest

from repro.evaluation.paired import paired_differences
from repro.evaluation.scoring import measure
from repro.metrics.headings import SUMMARY

MAPS = (np.random.default_rng(0).random((40, 1, 16, 16)) > 0.1).astype(np.uint8)


def with_errors(share: float, seed: int) -> np.ndarray:
    """Return predictions that are wrong in a share of the pixels."""
    is_wrong = np.random.default_rng(seed).random(MAPS.shape) < share
    return np.where(is_wrong, 1.0 - MAPS, MAPS) * 0.8 + 0.1


def test_the_differences_are_those_of_the_pooled_metrics():
    one, other = with_errors(0.05, 1), with_errors(0.1, 2)
    rows = pd.DataFrame(paired_differences(one, other, MAPS)).set_index("metric")
    expected = measure(one, MAPS)[0] - measure(other, MAPS)[0]
    for metric in (*SUMMARY, "ssim"):
        assert rows.loc[metric, "value"] == pytest.approx(expected[metric], abs=1e-3), metric
        assert rows.loc[metric, "low"] < rows.loc[metric, "value"] < rows.loc[metric, "high"]
        assert rows.loc[metric, "excludes_zero"]
    swapped = pd.DataFrame(paired_differences(other, one, MAPS)).set_index("metric")
    assert np.allclose(swapped["value"], -rows["value"])


def test_a_prediction_does_not_differ_from_itself_in_any_type():
    free = with_errors(0.1, 1)
    rows = pd.DataFrame(paired_differences(free.astype(np.float32), free, MAPS))
    assert (rows[["value", "low", "high"]] == 0).all(axis=None)
    assert not rows["excludes_zero"].any()


@pytest.mark.parametrize(
    ("one", "maps", "message"),
    [
        (with_errors(0.1, 1), MAPS * 255, "maps: expected 0 and 1"),
        (with_errors(0.1, 1), MAPS * 0.5, "maps: expected 0 and 1"),
        (with_errors(0.1, 1)[:38], MAPS, r"one: expected probabilities .* got \(38, 1, 16, 16\)"),
        (MAPS[:, 0], MAPS[:, 0], r"maps: expected the shape \(M, 1, H, W\) with an even M, got \(40, 16, 16\)"),
        (MAPS[:3], MAPS[:3], r"maps: expected .* an even M, got \(3, 1, 16, 16\)"),
    ],
)
def test_predictions_of_other_recordings_or_units_are_refused(one, maps, message):
    with pytest.raises(ValueError, match=message):
        paired_differences(one, with_errors(0.1, 2), maps)
