r"""The training loss of the paper, binary cross-entropy plus Dice, and that of DeepTracking, without true maps.

    L = L_BCE + L_Dice                                                              (Eq. 3)
    L_BCE = -1/N \sum_i [g_i log p_i + (1 - g_i) log(1 - p_i)]                      (Eq. 1)
    L_Dice = 1 - 2 \sum_i p_i g_i / (\sum_i p_i^2 + \sum_i g_i^2 + eps)             (Eq. 2)

The sums run over all N pixels of the batch. The `DiceLoss` of segmentation_models_pytorch is a different loss: its
denominator has no squares.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F


def bce_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Compute the binary cross-entropy, Eq. 1; p = sigmoid(logits) and g = target have the same shape."""
    return F.binary_cross_entropy_with_logits(logits, target)


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

    def of_batch(self, network: nn.Module, images: Tensor, target: Tensor) -> Tensor:
        """Compute the loss of a network for images (B, C, H, W) and true maps (B, 1, H, W)."""
        return self(network(images), target)


class VisibleLoss(nn.Module):
    """The loss of DeepTracking: cross-entropy on the pixels that each part of the window shows, without the true map.

    A pixel with a hit shows an obstacle, another pixel that a beam passes over shows free space, all others do not
    count. The network receives every other tenth of the window and predicts the map after every part, so that it must
    continue what it has seen. The authors show ten scans and hide the next ten, in sequences of 100 scans (Ondruska
    and Posner, AAAI 2016; version 1.1 of their code).
    """

    def forward(self, logits: Tensor, images: Tensor) -> Tensor:
        """Compute the loss of the logits after every part, (B, K, H, W), from the whole series, (B, 2 K, H, W)."""
        hits, passed = images.float().chunk(2, dim=1)
        shown = torch.maximum(hits, passed)
        total = F.binary_cross_entropy_with_logits(logits.float(), 1 - hits, weight=shown, reduction="sum")
        return total / shown.sum().clamp(min=1)

    def of_batch(self, network: nn.Module, images: Tensor, _: Tensor) -> Tensor:
        """Compute the loss of a network for the images of a series, (B, 2 K, H, W); the true maps are not used."""
        return self(network(hide_tenths(images), every_part=True), images)


def hide_tenths(images: Tensor) -> Tensor:
    """Return a series, (B, 2 K, H, W), with zeros in every other tenth of its K parts, or part if K is below 20."""
    frames = images.shape[1] // 2
    tenth = torch.arange(frames, device=images.device) // max(frames // 10, 1)
    shown = (tenth % 2 == 0).to(images.dtype).repeat(2)
    return images * shown[:, None, None]


def create_loss(name: str, dice_eps: float) -> MapLoss | VisibleLoss:
    """Create a loss from its name in `config.LOSSES`; only `map` has the Dice loss with its epsilon."""
    return VisibleLoss() if name == "visible" else MapLoss(dice_eps)
