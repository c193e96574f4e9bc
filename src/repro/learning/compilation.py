"""Compilation of a network with torch.compile for its training."""

import copy
import logging

import torch
from lightning.pytorch.plugins import Precision
from torch import nn

from repro.system.devices import compiles

log = logging.getLogger(__name__)


def compile_network(network: nn.Module, batch: tuple[int, ...], device: str, precision: Precision) -> bool:
    """Compile a network in place, after a copy of it has been compiled and run forward and backward as in training.

    Args:
        network: the network as it is trained, with its kernels and memory format.
        batch: shape of a training batch, (B, C, H, W).
        device: cpu or cuda.
        precision: the precision of the training.

    Returns:
        whether it is compiled; if not, the reason has been printed and the network is unchanged.
    """
    log.info("compiling the network, which takes a minute or two")
    spare = precision.convert_module(copy.deepcopy(network).to(device))
    images = precision.convert_input(torch.zeros(batch, device=device)).to(memory_format=torch.channels_last)
    with precision.forward_context():
        if not compiles(spare, images):
            return False
    network.compile()
    return True
