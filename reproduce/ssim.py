"""Measure the SSIM of piqa under torch.autocast: can 16 bits explain the paper's lower values?

    python -m reproduce.ssim

predicts test maps with published networks of 128 px (those of 256 px are not published), enlarges the logits to 256 px,
and compares them with true maps of 256 px, by autocast of this CPU and by the rules of a GPU: each convolution takes
inputs rounded to 16 bits, sums in float32 and rounds the result, powers are of float32 (on a CPU they are not), and all
else has the type of its operands. The ratios to float32 go to reproduce/results/ssim/autocast.csv.
"""

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from piqa import SSIM
from piqa.utils.functional import gaussian_kernel
from torch import Tensor
from torch.nn.functional import conv2d, interpolate

from repro.evaluation.image_metrics import ssim
from repro.learning.networks.trained import load_trained
from repro.maps.grid import Grid
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import load_recorded
from repro.reporting.paper import WORLDS
from repro.runs.provenance import environment
from repro.simulation.recorder import record_experiment
from repro.system.files import write_json, write_text
from repro.worlds.spec import read_world, world_spec

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "reproduce" / "results"
NETWORKS = [  # experiment, network, its directory
    ("1", "convgru", "workstation/exp1-convgru"),
    ("2", "convgru", "workstation/exp2-convgru"),
    ("3", "convgru", "workstation-16000/exp3-convgru"),
    ("4", "convgru", "workstation-16000/exp4-convgru"),
    ("4", "unet", "workstation/exp4-unet"),
]
PAIRS, SIZE_PX = 40, 256
TYPES = {"bfloat16": torch.bfloat16, "float16": torch.float16}
TEMPERATURES = (1.0, 1.6)  # by which the logits are divided: less saturated predictions
C1, C2 = 0.01**2, 0.03**2  # piqa's constants


def smooth(images: Tensor, kind: torch.dtype) -> Tensor:
    """Smooth images (M, 1, H, W) with piqa's window, first down, then across, each in 16 bits."""
    window = gaussian_kernel(11, 1.5).to(kind).float()
    for shape in ((1, 1, -1, 1), (1, 1, 1, -1)):
        images = conv2d(images.to(kind).float(), window.view(shape)).to(kind)
    return images


def ssim_cpu(free: Tensor, truth: Tensor, kind: torch.dtype) -> Tensor:
    """Compute the SSIM as `ssim_gpu`, under autocast of the CPU."""
    with torch.autocast("cpu", kind):
        return SSIM(n_channels=1, reduction="none", value_range=1.0)(free, truth).float()


def ssim_gpu(free: Tensor, truth: Tensor, kind: torch.dtype) -> Tensor:
    """Compute the SSIM of images (M, 1, H, W), (M,), as `piqa.ssim` does on a GPU under autocast.

    Args:
        free: probabilities of free, of 16 bits as a network gives them under autocast.
        truth: true maps, in float32.
        kind: type of the convolutions.
    """
    mean_x, mean_y = smooth(free, kind), smooth(truth, kind)
    square_x, square_y, both = mean_x.float() ** 2, mean_y.float() ** 2, mean_x * mean_y
    variance_x = smooth(free.float() ** 2, kind) - square_x
    variance_y = smooth(truth**2, kind) - square_y
    covariance = smooth(free * truth, kind) - both
    contrast = (2 * covariance + C2) / (variance_x + variance_y + C2)
    return ((2 * both + C1) / (square_x + square_y + C1) * contrast).float().flatten(1).mean(1)


RULES = {"gpu": ssim_gpu, "cpu": ssim_cpu}


def enlarged(free: np.ndarray) -> Tensor:
    """Return the logits of probabilities (M, H, W), enlarged to 256 px, (M, 1, 256, 256)."""
    logits = torch.logit(torch.from_numpy(free).float()[:, None], eps=1e-6)
    return interpolate(logits, size=(SIZE_PX, SIZE_PX), mode="bilinear")


def compare(logits: Tensor, maps: np.ndarray, kind: str, rules: str) -> dict[str, float]:
    """Compare the mean SSIM in 16 bits with that in float32, of all images where it is finite.

    Args:
        logits: see `enlarged`.
        maps: the true maps, (M, 1, 256, 256).
        kind: bfloat16 or float16.
        rules: gpu or cpu.
    """
    plain = ssim(torch.sigmoid(logits).numpy(), maps)
    rounded, truth = torch.sigmoid(logits.to(TYPES[kind])), torch.from_numpy(np.asarray(maps, np.float32))
    parts = zip(rounded.split(4), truth.split(4), strict=True)  # small arrays, which stay in the cache
    found = torch.cat([RULES[rules](*part, TYPES[kind]) for part in parts]).numpy()
    finite = np.isfinite(found)
    return {"float32": plain.mean(), "ratio": found[finite].mean() / plain[finite].mean(), "finite": finite.mean()}


def measured(experiment: str, model: str, weights: str) -> Iterator[dict[str, object]]:
    """Yield the comparisons of a network, at all temperatures, types and rules."""
    recordings = ROOT / "outputs" / "ssim" / "recordings" / f"exp{experiment}"
    record_experiment(recordings, world_spec(read_world(WORLDS), experiment), {"train": 2, "val": 2, "test": PAIRS})
    network, opened = load_trained(RESULTS / weights), open_recordings(recordings)
    logits = enlarged(network.predict(load_recorded(opened, "test", network.grid).scans))
    maps = load_recorded(opened, "test", Grid(SIZE_PX, network.grid.size_m)).maps
    for temperature, kind, rules in product(TEMPERATURES, TYPES, RULES):
        about = {"experiment": experiment, "model": model, "temperature": temperature, "type": kind, "rules": rules}
        yield {**about, **compare(logits / temperature, maps, kind, rules)}


def main() -> None:
    """Measure all networks, and write the ratios and where they come from."""
    rows: list[dict[str, object]] = []
    origin = environment()
    for network in NETWORKS:
        rows += measured(*network)
        print(pd.DataFrame(rows).to_string(float_format="{:.3f}".format), flush=True)
    table = pd.DataFrame(rows)
    write_text(RESULTS / "ssim" / "autocast.csv", table.to_csv(index=False, float_format="%.4g"))
    write_json(RESULTS / "ssim" / "autocast.json", {"networks": NETWORKS, "test_pairs": PAIRS, **origin})


if __name__ == "__main__":
    main()
