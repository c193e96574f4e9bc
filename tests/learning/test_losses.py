import math

import pytest
import torch

from repro.learning.losses import MapLoss, VisibleLoss, bce_loss, dice_loss, hide_tenths
from repro.networks.deeptracking import DeepTracking

# p = 0.5, 0.8, 0.2, 0.9 and g = 1, 1, 0, 0, worked out by hand
LOGITS = torch.tensor([0.0, math.log(4), -math.log(4), math.log(9)]).view(1, 1, 2, 2)
TARGET = torch.tensor([1.0, 1.0, 0.0, 0.0]).view(1, 1, 2, 2)
BCE = -(math.log(0.5) + math.log(0.8) + math.log(0.8) + math.log(0.1)) / 4
DICE = 1 - 2 * (0.5 + 0.8) / ((0.25 + 0.64 + 0.04 + 0.81) + 2)


def test_equation_1():
    assert bce_loss(LOGITS, TARGET).item() == pytest.approx(BCE, rel=1e-6)


def test_equation_2_has_squares_in_the_denominator():
    assert dice_loss(LOGITS, TARGET).item() == pytest.approx(DICE, rel=1e-5)


def test_equation_3_is_their_sum():
    assert MapLoss()(LOGITS, TARGET).item() == pytest.approx(BCE + DICE, rel=1e-5)


def test_the_loss_of_a_perfect_prediction_is_zero_and_of_a_wrong_one_large():
    logits = 40 * (2 * TARGET - 1)
    assert MapLoss()(logits, TARGET).item() == pytest.approx(0, abs=1e-6)
    assert MapLoss()(-logits, TARGET).item() > 40


def test_dice_is_taken_over_the_whole_batch():
    batch, target = torch.cat([LOGITS, -LOGITS]), torch.cat([TARGET, TARGET])
    p = torch.sigmoid(batch).flatten()
    expected = 1 - 2 * (p @ target.flatten()) / (p @ p + target.sum())
    assert dice_loss(batch, target).item() == pytest.approx(expected.item(), rel=1e-5)


def test_the_loss_of_half_precision_logits_is_computed_in_float32():
    loss = MapLoss()(LOGITS.bfloat16(), TARGET)
    assert loss.dtype == torch.float32
    assert loss.item() == pytest.approx(BCE + DICE, rel=1e-2)


def test_the_visible_loss_counts_hits_as_obstacles_and_other_passed_pixels_as_free():
    hits = torch.tensor([1.0, 0.0, 1.0, 0.0]).view(1, 1, 2, 2)
    passed = torch.tensor([0.0, 1.0, 1.0, 0.0]).view(1, 1, 2, 2)  # the third pixel has a hit as well
    expected = -(math.log(0.5) + math.log(0.8) + math.log(0.8)) / 3  # the fourth pixel is not shown
    loss = VisibleLoss()(LOGITS, torch.cat([hits, passed], dim=1))
    assert loss.item() == pytest.approx(expected, rel=1e-6)


def test_the_visible_loss_of_windows_that_show_nothing_is_zero():
    assert VisibleLoss()(LOGITS, torch.zeros(1, 2, 2, 2)).item() == 0


@pytest.mark.parametrize(
    ("frames", "shown"), [(4, [0, 2]), (10, [0, 2, 4, 6, 8]), (20, [0, 1, 4, 5, 8, 9, 12, 13, 16, 17])]
)
def test_every_other_tenth_of_a_series_is_hidden(frames, shown):
    images = torch.rand(2, 2 * frames, 3, 3) + 0.1
    hidden = hide_tenths(images)
    kept = torch.tensor(shown + [frames + part for part in shown])
    assert torch.equal(hidden.sum(dim=(0, 2, 3)).nonzero().flatten(), kept)
    assert torch.equal(hidden[:, kept], images[:, kept])


def test_the_visible_loss_uses_no_true_map_and_trains_without_the_hidden_parts():
    torch.manual_seed(0)
    network, images = DeepTracking(20, frames=10), (torch.rand(2, 20, 16, 16) < 0.2).float()
    loss = VisibleLoss().of_batch(network, images, torch.full((2, 1, 16, 16), torch.nan))
    with torch.no_grad():
        maps = network(hide_tenths(images), every_part=True)
    assert loss.item() == pytest.approx(VisibleLoss()(maps, images).item(), rel=1e-6)
