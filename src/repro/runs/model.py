"""The description of a network: what `learning.networks.create` creates."""

from dataclasses import dataclass, field
from typing import Any

from repro.system.fields import KNOWN_KEYS, Name

NETWORKS = ("unet", "fpn", "upernet", "segformer")  # the paper's four, in its order
PAPER_ENCODER = "mit_b0"


@dataclass(frozen=True)
class Model:
    """A network and its encoder, or a baseline, which has a name alone.

    Args:
        name: name of the model in paths and tables.
        architecture: one of our own (`learning.networks.create`) or of segmentation-models-pytorch; None means that the
            name is one.
        encoder_name: encoder of segmentation-models-pytorch; None for a network with an encoder of its own.
        encoder_weights: pretrained weights of the encoder; None trains from scratch.
        parameters: further parameters of one of our own networks.
    """

    __pydantic_config__ = KNOWN_KEYS

    name: Name
    architecture: str | None = None
    encoder_name: str | None = None
    encoder_weights: str | None = None
    parameters: dict[str, Any] = field(default_factory=dict, hash=False)

    @property
    def kind(self) -> str:
        """Name of the architecture."""
        return self.architecture or self.name


def paper_model(name: str) -> Model:
    """Return one of the paper's networks with the paper's encoder, trained from scratch."""
    return Model(name, encoder_name=PAPER_ENCODER)
