import math

import pytest
import torch

from repro.learning.losses import MapLoss, bce_loss, dice_loss

# p = 0.5, 0.8, 0.2, 0.9 and g = 1, 1, 0, 0, worked out by hand
LOGITS = torch.tensor([0.0, math.log(4), -math.log(4), math.log(9)]).view(1, 1, 2, 2)
TARGET = torch.tensor([1.0, 1.0, 0.0, 0.0]).view(1, 1, 2, 2)
BCE = -(math.log(0.5) + math.log(0.8) + math.log(0.8) + math.log(0.1)) / 4
DICE = 1 - 2 * (0.5 + 0.8) / ((0.25 + 0.64 + 0.04 + 0.81) + 2)


def test_equation_1():
    assert bce_loss(LOGITS, TARGET).item() == pytest.approx(BCE, rel=1e-6)


def test_unknown_pixels_do_not_count():
    known = torch.tensor([1.0, 1.0, 1.0, 0.0]).view(1, 1, 2, 2)
    expected = -(math.log(0.5) + math.log(0.8) + math.log(0.8)) / 3
    assert bce_loss(LOGITS, TARGET, known).item() == pytest.approx(expected, rel=1e-6)
    assert bce_loss(LOGITS, TARGET, torch.zeros_like(known)).item() == 0


def test_equation_2_has_squares_in_the_denominator():
    assert dice_loss(LOGITS, TARGET).item() == pytest.approx(DICE, rel=1e-5)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.bfloat16, 1e-2)])
def test_equation_3_is_their_sum_in_float32(dtype, tolerance):
    loss = MapLoss()(LOGITS.to(dtype), TARGET)
    assert loss.dtype == torch.float32
    assert loss.item() == pytest.approx(BCE + DICE, rel=tolerance)


def test_the_loss_of_a_perfect_prediction_is_zero_and_of_a_wrong_one_large():
    logits = 40 * (2 * TARGET - 1)
    assert MapLoss()(logits, TARGET).item() == pytest.approx(0, abs=1e-6)
    assert MapLoss()(-logits, TARGET).item() > 40


def test_dice_is_taken_over_the_whole_batch():
    batch, target = torch.cat([LOGITS, -LOGITS]), torch.cat([TARGET, TARGET])
    p = torch.sigmoid(batch).flatten()
    expected = 1 - 2 * (p @ target.flatten()) / (p @ p + target.sum())
    assert dice_loss(batch, target).item() == pytest.approx(expected.item(), rel=1e-5)
