import numpy as np
import pytest
import torch
from torchmetrics.functional import classification as tm
from torchmetrics.functional.image import structural_similarity_index_measure

from repro.evaluation.image_metrics import ssim
from repro.metrics.counts import confusion_of, counts_of, pooled_scores
from repro.metrics.scores import checked_probabilities, scores
from repro.system.errors import InputError


@pytest.fixture
def images():
    """Predictions with errors of both kinds, of different frequency, and true maps."""
    rng = np.random.default_rng(0)
    target = (rng.random((6, 1, 40, 40)) > 0.1).astype(np.float32)
    return (0.2 + 0.25 * target + 0.4 * rng.random(target.shape, np.float32)).clip(0, 1), target


@pytest.mark.parametrize(("prefix", "flip"), [("", False), ("obstacle_", True)])
def test_pooled_metrics_agree_with_torchmetrics(images, prefix, flip):
    probability, target = images
    found = pooled_scores(counts_of(probability, target).sum(0))
    predicted, truth = (torch.from_numpy(values).int() for values in (probability > 0.5, target))
    assert len({*confusion_of(counts_of(probability, target).sum(0)).tolist(), 0}) == 5, "all four kinds of pixels"
    if flip:
        predicted, truth = 1 - predicted, 1 - truth
    expected = {
        "dice": tm.binary_f1_score(predicted, truth),
        "precision": tm.binary_precision(predicted, truth),
        "recall": tm.binary_recall(predicted, truth),
        "specificity": tm.binary_specificity(predicted, truth),
    }
    for name, value in expected.items():
        if prefix + name in found:  # the recall of obstacles is the specificity
            assert found[prefix + name].item() == pytest.approx(value.item(), abs=1e-6), name
    assert found["accuracy"].item() == pytest.approx(tm.binary_accuracy(predicted, truth).item(), abs=1e-6)
    if flip:
        iou = tm.binary_jaccard_index(predicted, truth)
        assert found["obstacle_iou"].item() == pytest.approx(iou.item(), abs=1e-6)


def test_free_is_the_positive_class_also_at_a_probability_of_one_half():
    target = np.array([1.0, 1.0, 1.0, 0.0]).reshape(1, 1, 2, 2)
    for probability in (1.0, 0.5):
        counts = counts_of(np.full((1, 1, 2, 2), probability), target)
        assert confusion_of(counts).tolist() == [[3, 1, 0, 0]]
    assert confusion_of(counts_of(np.full((1, 1, 2, 2), 0.49999997), target)).tolist() == [[0, 0, 1, 3]]
    all_free = pooled_scores(counts.sum(0))
    assert all_free["recall"] == pytest.approx(1)
    assert all_free["specificity"] == pytest.approx(0, abs=1e-4)
    assert all_free["precision"] == pytest.approx(0.75, abs=1e-4)


def test_eps_is_in_numerator_and_denominator_as_in_segmentation_metrics_pytorch():
    assert scores(np.array([4, 0, 0, 0]))["specificity"].item() == 1
    assert scores(np.array([0, 1, 0, 0]))["precision"].item() == pytest.approx(1e-5, rel=1e-3)


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (np.zeros((1, 1, 2, 3)), r"\(1, 1, 2, 2\) as the maps, got \(1, 1, 2, 3\)"),
        ([[[[0.5, 0.5], [0.5, 0.5]]]], r"\(1, 1, 2, 2\) as the maps, got list"),
        (np.array([0.0, 0.5, 1.0, 2.0]).reshape(1, 1, 2, 2), "values from 0 to 2: logits need a sigmoid"),
        (np.array([0.0, 0.5, 1.0, -1.0]).reshape(1, 1, 2, 2), "values from -1 to 1"),
        (np.array([0.0, 0.5, 1.0, np.nan]).reshape(1, 1, 2, 2), "values from nan"),
    ],
)
def test_predictions_that_are_no_probabilities_of_the_maps_are_refused(free, message):
    maps = np.ones((1, 1, 2, 2))
    with pytest.raises(InputError, match=message):
        checked_probabilities(free, maps)
    assert checked_probabilities(np.array([0.0, 0.5, 0.5, 1.0]).reshape(1, 1, 2, 2), maps).dtype == np.float32


def test_ssim_agrees_with_torchmetrics_and_is_one_for_the_truth(images):
    probability, target = images
    _, reference = structural_similarity_index_measure(
        *map(torch.from_numpy, images), data_range=1.0, reduction="none", return_full_image=True
    )
    inner = reference[..., 5:-5, 5:-5].flatten(1).mean(1)  # piqa has no padding
    np.testing.assert_allclose(ssim(probability, target, batch=4), inner, atol=1e-4)
    np.testing.assert_allclose(ssim(target, target), 1)
