"""The networks: the four of the paper, from segmentation-models-pytorch, and `convlstm.ConvLSTM`."""

import json
from pathlib import Path
from typing import TypeAlias

import segmentation_models_pytorch as smp
from segmentation_models_pytorch.base import SegmentationModel

from repro.config import LEARNED
from repro.learning.convlstm import ConvLSTM

Network: TypeAlias = SegmentationModel | ConvLSTM


def create_model(
    architecture: str, *, encoder_name: str = "mit_b0", encoder_weights: str | None = None, in_channels: int = 1
) -> Network:
    """Creates a network from encoded scans (B, C, H, W) to one map of logits (B, 1, H, W).

    Paper: "Prediction Models". Encoder weights and channels are not stated: DEVIATIONS D9.

    Args:
        architecture: one of `config.LEARNED`.
        encoder_name: an smp encoder; `convlstm` has its own.
        encoder_weights: None to start from scratch, or `imagenet`.
        in_channels: channels of the encoding, C.

    Raises:
        ValueError: the architecture is unknown, or the encoder weights cannot be had.
    """
    if architecture not in LEARNED:
        raise ValueError(f"architecture must be one of {', '.join(LEARNED)}, got {architecture!r}")
    if architecture == "convlstm":
        return ConvLSTM(in_channels)
    try:
        return smp.create_model(
            architecture,
            encoder_name=encoder_name,
            encoder_weights=encoder_weights,
            in_channels=in_channels,
            classes=1,
        )
    except Exception as error:
        if encoder_weights is None:
            raise
        raise ValueError(
            f"the {encoder_weights} weights of {encoder_name} could not be had ({type(error).__name__}: {error}); "
            "connect to the internet once, or train from scratch with model.encoder_weights=null"
        ) from error


def load_model(directory: Path) -> Network:
    """Loads a network that `save_pretrained` wrote, with weights in float32."""
    is_smp = "_model_class" in json.loads((directory / "config.json").read_text())  # smp notes there which it is
    return (smp.from_pretrained(directory) if is_smp else ConvLSTM.from_pretrained(directory)).float()
