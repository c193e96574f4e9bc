"""Calibration of a network: its logits are scaled and shifted (Platt, "Probabilistic outputs for SVMs", 1999)."""

import numpy as np
import torch
from sklearn.linear_model import LogisticRegression
from torch import nn

from repro.learning.labels import UNKNOWN
from repro.recordings.datasets import Pairs


@torch.inference_mode()
def calibrate(network: nn.Module, pairs: Pairs) -> None:
    """Scale and shift the logits of a network, in the convolution that draws the map, to fit known pixels.

    Args:
        network: the network, which is changed.
        pairs: windows with labels, see `Labeled`.
    """
    network.eval()
    logits, free, weights = [], [], []
    for number in range(len(pairs)):
        image, target = pairs.batch(torch.tensor([number], device=pairs.maps.device))
        codes = target.to(torch.uint8)
        known = (codes & UNKNOWN) == 0
        logits.append(network(image)[known].float().cpu())
        free.append((codes[known] & 1).cpu())
        weights.append(torch.full_like(logits[-1], 1 / max(len(logits[-1]), 1)))  # windows count alike, as in the loss
    values, truth, weight = (torch.cat(parts).numpy() for parts in (logits, free, weights))
    model = LogisticRegression(C=np.inf).fit(values[:, None], truth, weight)
    *_, last = (layer for layer in network.modules() if isinstance(layer, nn.Conv2d) and layer.out_channels == 1)
    last.weight.mul_(float(model.coef_[0, 0]))
    assert last.bias is not None
    last.bias.mul_(float(model.coef_[0, 0])).add_(float(model.intercept_[0]))
