"""Measure why FPN is behind U-Net after few steps: both networks with one change each, on validation data.

    python run.py -m task=record exp=1,3 scale=laptop scale.pairs.val=500 outputs=outputs/fpn_decoder
    python reproduce/fpn_decoder.py outputs/fpn_decoder --exp 1 3

trains every variant with the pairs and the schedule of the laptop scale on one thread and adds a row to
fpn_decoder.csv in the outputs. A training takes about two minutes.
"""

import argparse
import os
from collections.abc import Callable
from itertools import product
from pathlib import Path

import pandas as pd
import segmentation_models_pytorch as smp
import torch
from segmentation_models_pytorch.decoders.fpn.decoder import Conv3x3GNReLU
from torch import Tensor, nn
from torch.nn import functional as F

from repro.config import Training
from repro.evaluation.evaluate import measure
from repro.learning.callbacks import exponential_moving_average
from repro.learning.kernels import accelerate
from repro.learning.training import TrainingModule, create_trainer
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.create import Network, create_network
from repro.networks.model import paper_model
from repro.recordings.datasets import Batches, Pairs, load_pairs
from repro.system.devices import one_thread, resolve_precision

GRID, PAIRS = Grid(64, 50.0), {"train": 2000, "val": 500}
SCHEDULE = Training(1e-3, 1e-3, 99, 8, 5, 1e-6, flip_augmentation=True, ema_decay=0.99)
SHARE = 4  # the decoder of FPN ends at a quarter of the resolution
COLUMNS = ["accuracy", "specificity", "obstacle_iou"]


class UnalignedBlock(Conv3x3GNReLU):
    """A block of FPN's decoder that upsamples as UPerNet and Segformer do, without aligned corners."""

    def forward(self, images: Tensor) -> Tensor:
        """Return the convolved images, (B, C, H, W) or (B, C, 2 H, 2 W)."""
        images = self.block(images)
        return F.interpolate(images, scale_factor=2.0, mode="bilinear") if self.upsample else images


class Coarsened(nn.Module):
    """A head whose logits are averaged to a quarter of the resolution and interpolated back."""

    def __init__(self, head: nn.Module) -> None:
        super().__init__()
        self.head = head

    def forward(self, features: Tensor) -> Tensor:
        """Return the logits, (B, 1, H, W)."""
        return F.interpolate(F.avg_pool2d(self.head(features), SHARE), scale_factor=float(SHARE), mode="bilinear")


def upsampling_head(channels: int) -> nn.Sequential:
    """Create a head that upsamples twice and convolves, as U-Net does, instead of interpolating its logits."""

    def block(inputs: int, outputs: int) -> list[nn.Module]:
        convolution = nn.Conv2d(inputs, outputs, 3, padding=1, bias=False)
        return [nn.Upsample(scale_factor=2), convolution, nn.BatchNorm2d(outputs), nn.ReLU()]

    return nn.Sequential(*block(channels, 32), *block(32, 16), nn.Conv2d(16, 1, 3, padding=1))


def fpn(
    *, dropout: float = 0.2, aligned: bool = True, batch_norm: bool = False, head: bool = False
) -> Callable[[], Network]:
    """Return a function that creates an FPN; the defaults are those of smp."""

    def create() -> Network:
        network = smp.create_model(
            "fpn", "mit_b0", encoder_weights=None, in_channels=1, classes=1, decoder_dropout=dropout
        )
        for block in network.modules():
            if type(block) is Conv3x3GNReLU:
                if not aligned:
                    block.__class__ = UnalignedBlock
                if batch_norm:
                    block.block[1] = nn.BatchNorm2d(block.block[1].num_channels)
        if head:
            network.segmentation_head = upsampling_head(network.decoder.out_channels)
        return network

    return create


def unet(*, coarse: bool = False) -> Callable[[], Network]:
    """Return a function that creates the paper's U-Net, or one with a quarter of the resolution."""

    def create() -> Network:
        network = create_network(paper_model("unet"))
        if coarse:
            network.segmentation_head = Coarsened(network.segmentation_head)
        return network

    return create


VARIANTS = {
    "U-Net": unet(),
    "U-Net, logits averaged over 4 x 4 pixels": unet(coarse=True),
    "FPN": fpn(),
    "FPN without dropout": fpn(dropout=0.0),
    "FPN with batch normalization": fpn(batch_norm=True),
    "FPN without aligned corners": fpn(aligned=False),
    "FPN with a head that upsamples and convolves": fpn(head=True),
    "FPN with all four changes": fpn(dropout=0.0, aligned=False, batch_norm=True, head=True),
}


def train_variant(create: Callable[[], Network], data: dict[str, Pairs], seed: int) -> pd.Series:
    """Train a network and measure it on the validation pairs."""
    torch.manual_seed(seed)
    network, precision = create(), resolve_precision("auto", "cpu")
    accelerate(network, "cpu")
    module = TrainingModule(network, data["train"], data["val"], SCHEDULE, seed)
    average = exponential_moving_average(SCHEDULE.ema_decay or 0.0)
    create_trainer(SCHEDULE.max_epochs, "cpu", precision, [average]).fit(module)
    network.eval()
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=precision.startswith("bf16")):
        batches = [images.to(memory_format=torch.channels_last) for images, _ in Batches(data["val"], 20)]
        probability = torch.cat([network(images).float().sigmoid() for images in batches])
    return measure(probability, data["val"].maps)[0][COLUMNS]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("outputs", type=Path, help="outputs directory with the recordings")
    parser.add_argument("--exp", nargs="+", default=["1"], help="experiments")
    parser.add_argument("--seed", nargs="+", type=int, default=[0, 1], help="seeds")
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=VARIANTS, metavar="VARIANT")
    options = parser.parse_args()
    table = options.outputs / "fpn_decoder.csv"
    for experiment in options.exp:
        recordings = options.outputs / "recordings" / f"exp{experiment}"
        data = {split: load_pairs(recordings, split, GRID, Projection(), count=n) for split, n in PAIRS.items()}
        for name, seed in product(options.variants, options.seed):
            with one_thread():
                scores = train_variant(VARIANTS[name], data, seed)
            row = pd.DataFrame([{"experiment": experiment, "variant": name, "seed": seed, **scores}])
            row.to_csv(table, mode="a", header=not os.path.exists(table), index=False, float_format="%.5f")
            print(row.to_string(index=False, header=False), flush=True)


if __name__ == "__main__":
    main()
