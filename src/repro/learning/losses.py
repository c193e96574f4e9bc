r"""The training loss of the paper, binary cross-entropy plus Dice.

    L = L_BCE + L_Dice                                                              (Eq. 3)
    L_BCE = -1/N \sum_i [g_i log p_i + (1 - g_i) log(1 - p_i)]                      (Eq. 1)
    L_Dice = 1 - 2 \sum_i p_i g_i / (\sum_i p_i^2 + \sum_i g_i^2 + eps)             (Eq. 2)

The sums run over all N pixels of the batch. The `DiceLoss` of segmentation_models_pytorch is a different loss: its
denominator has no squares.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from repro.recordings.datasets import HIDDEN

HIDDEN_WEIGHT = 0.1  # ours, of a pixel that standing obstacles hide


def bce_loss(logits: Tensor, target: Tensor, known: Tensor | None = None) -> Tensor:
    """Compute the binary cross-entropy, Eq. 1; p = sigmoid(logits) and g = target have the same shape.

    With `known`, 1 where the target is known and 0 elsewhere, the unknown pixels do not count; without any known pixel
    the loss is 0.
    """
    if known is None:
        return F.binary_cross_entropy_with_logits(logits, target)
    total = F.binary_cross_entropy_with_logits(logits, target, weight=known, reduction="sum")
    return total / known.sum().clamp(min=1)


def dice_loss(logits: Tensor, target: Tensor, eps: float = 1e-6) -> Tensor:
    """Compute the Dice loss with squares in the denominator, Eq. 2; p = sigmoid(logits), g = target, same shape."""
    p = torch.sigmoid(logits)
    return 1 - 2 * (p * target).sum() / (p.square().sum() + target.square().sum() + eps)


class MapLoss(nn.Module):
    """The sum of both losses, Eq. 3. The paper does not state the value of eps: DEVIATIONS D8."""

    def __init__(self, eps: float = 1e-6) -> None:
        super().__init__()
        self.eps = eps

    def forward(self, logits: Tensor, target: Tensor) -> Tensor:
        """Compute the loss of logits (B, 1, H, W) against true maps (B, 1, H, W) with 1 = free, in float32."""
        logits, target = logits.float(), target.float()
        return bce_loss(logits, target) + dice_loss(logits, target, self.eps)


class ShownLoss(nn.Module):
    """Binary cross-entropy, Eq. 1, in which what standing obstacles hide from a lidar at the last step counts a tenth.

    Most of a map of rooms is behind walls. Far from all hits, an obstacle is much less probable if a lidar shows the
    pixel than if a wall may hide it. What moves hides nothing: else the far side of people would count a tenth, too,
    and half of their area would be missing in the maps.
    """

    def forward(self, logits: Tensor, target: Tensor) -> Tensor:
        """Compute the loss of logits (B, 1, H, W) against true maps with hidden pixels, see `Pairs`, in float32."""
        hidden = target >= HIDDEN
        return bce_loss(logits.float(), target.float() - HIDDEN * hidden.float(), shown_weight(hidden))


def shown_weight(hidden: Tensor) -> Tensor:
    """Return the weight of pixels, given whether standing obstacles hide them, of the same shape."""
    return 1.0 - (1.0 - HIDDEN_WEIGHT) * hidden.float()
