import numpy as np
import pytest
from sklearn.metrics import brier_score_loss, log_loss

from repro.metrics import calibration
from repro.metrics.counts import PROBABILITY, best_iou, count_quantized, pooled_scores


@pytest.fixture(scope="module")
def drawn():
    """Levels and truth of four small images, and the counts of all together."""
    rng = np.random.default_rng(0)
    free = rng.integers(0, 256, (4, 16, 16)).astype(np.uint8)
    truth = (rng.random((4, 16, 16)) < free / 255).astype(np.uint8)
    return free, truth, count_quantized(free, truth)[:, 0].sum(0)


def test_counts_are_by_image_group_truth_and_quantized_probability(drawn):
    free, truth, _ = drawn
    groups = np.arange(4)[:, None, None] % 3 + np.zeros((4, 16, 16), dtype=np.uint8)
    counts = count_quantized(free, truth, groups, 3)
    assert counts.shape == (4, 3, 2, 256)
    assert counts[1].sum() == counts[1, 1].sum() == 256
    assert counts[2, 2, 1, 17] == ((free[2] == 17) & (truth[2] == 1)).sum()


def test_scores_are_those_of_the_thresholded_images(drawn):
    free, truth, counts = drawn
    found = pooled_scores(counts)
    assert found["accuracy"] == pytest.approx(((free > 127) == truth).mean())
    assert found["specificity"] == pytest.approx((free[truth == 0] < 128).mean(), abs=1e-6)


def test_losses_and_curves_agree_with_scikit_learn(drawn):
    free, truth, counts = drawn
    probability, truth = free.ravel() / 255, truth.ravel()
    assert calibration.brier(counts) == pytest.approx(brier_score_loss(truth, probability))
    assert calibration.log_loss(counts) == pytest.approx(log_loss(truth, probability.clip(1 / 510, 1 - 1 / 510)))


def test_the_iou_of_obstacles_at_the_best_threshold(drawn):
    free, truth, counts = drawn
    obstacle = truth == 0
    at = [((free <= level) & obstacle).sum() / ((free <= level) | obstacle).sum() for level in range(256)]
    assert best_iou(counts) == pytest.approx(max(at))


def test_frequencies_equal_to_the_probabilities_are_calibrated():
    pixels = np.full(256, 51_000)
    counts = np.stack([pixels * (1 - PROBABILITY), pixels * PROBABILITY]).round().astype(np.int64)
    assert calibration.calibration_error(calibration.reliability(counts)) < 1e-4


def test_uncertain_predictions_are_measured_without_the_sure_ones():
    sure, even = np.zeros((2, 256)), np.zeros((2, 256))
    sure[1, 255] = 1_000_000  # certainly free, and right
    even[0, 255 - 51], even[1, 255 - 51] = 30, 70  # predicted 0.2, found 0.3
    even[0, 255 - 204], even[1, 255 - 204] = 70, 30  # predicted 0.8, found 0.7
    diagram = calibration.reliability(sure + even)
    assert calibration.calibration_error(diagram) < 1e-4
    assert calibration.uncertain_error(diagram) == pytest.approx(0.1)
    assert calibration.uncertain_skill(diagram) == pytest.approx((0.2**2 - 0.1**2) / 0.25)
    nothing = calibration.reliability(sure)
    assert np.isnan([calibration.uncertain_error(nothing), calibration.uncertain_skill(nothing)]).all()


def test_a_calibrated_constant_has_no_skill():
    counts = np.zeros((2, 256))
    counts[0, 204], counts[1, 204] = 20, 80
    diagram = calibration.reliability(counts)
    assert calibration.uncertain_error(diagram) == pytest.approx(0, abs=1e-9)
    assert calibration.uncertain_skill(diagram) == pytest.approx(0, abs=1e-9)


def test_entropy_is_highest_at_one_half():
    sure, unsure = np.zeros((2, 256)), np.zeros((2, 256))
    sure[1, 255] = unsure[1, 127] = unsure[0, 128] = 10
    assert calibration.entropy(sure) == pytest.approx(0, abs=1e-9)
    assert calibration.entropy(unsure) == pytest.approx(np.log(2), abs=1e-4)
