"""Test what could explain that the paper's SSIM is lower than ours: effects on predictions, and the SSIM that is left.

    python reproduce/ssim.py OUTPUTS [--recordings DIRECTORY] [--seed 0]

OUTPUTS holds evaluated U-Nets of the four experiments and of experiments 3 and 4 without decay, at any scale. Every
effect changes their predictions, or the way in which they are compared. The ratio of the SSIM with and without it then
changes our published averages of the paper's four networks at 256 px; what is left to the paper's averages is given as
the root mean square of the six differences. The rows go to reproduce/results/ssim/.
"""

import argparse
import io
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from PIL import Image
from piqa.ssim import ssim as piqa_ssim
from piqa.utils.functional import gaussian_kernel
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.evaluation.evaluate import read_predictions
from repro.maps.grid import Grid
from repro.metrics.scores import THRESHOLD
from repro.networks.model import NETWORKS
from repro.recordings.recorded import load_recorded
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import environment
from repro.system.files import write_json, write_text

RESULTS = Path(__file__).parent / "results"
TARGET = RESULTS / "ssim"
PAPER = Path(__file__).parents[1] / "src" / "repro" / "reporting" / "paper_tables" / "averages.csv"
CELLS = [*((name, PROJECTION) for name in "1234"), *((name, PROJECTION_NO_DECAY) for name in "34")]
CELL = ["experiment", "encoding"]
FINE = 4  # pixels of an anti-aliased map along the side of one


def ssim(free: Tensor, truth: Tensor, kernel: Tensor | None = None, value_range: float = 1.0) -> Tensor:
    """Compute the SSIM of images (M, 1, H, W), (M,), as `metrics.scores.ssim`, with another window or constants."""
    window = gaussian_kernel(11, 1.5) if kernel is None else kernel
    channels = window.repeat(1, 1, 1).to(free.dtype)
    return piqa_ssim(free, truth, channels, value_range=value_range)[0]


def jpeg(images: Tensor, quality: int) -> Tensor:
    """Store images (M, 1, H, W) as JPEG and read them."""
    stored = []
    for image in (images[:, 0] * 255).round().byte().numpy():
        file = io.BytesIO()
        Image.fromarray(image).save(file, "JPEG", quality=quality)
        stored.append(np.asarray(Image.open(file)))
    return torch.from_numpy(np.stack(stored))[:, None].float() / 255


def noisy(free: Tensor, std: float) -> Tensor:
    return free + std * torch.randn(free.shape, generator=torch.Generator().manual_seed(0))


def resized(images: Tensor, factor: float) -> Tensor:
    return interpolate(images, scale_factor=factor, mode="bilinear", antialias=factor < 1)


Effect = Callable[[Tensor, Tensor, Tensor, float], Tensor]  # of predictions, true maps, anti-aliased maps and a level
EFFECTS: dict[str, tuple[Effect, tuple[float, ...]]] = {
    "none": (lambda free, truth, *_: ssim(free, truth), (0,)),
    "predictions scaled by": (lambda free, truth, _, by: ssim(by * free, truth), (0.9, 0.8, 0.7, 0.6, 0.56, 0.5, 0.4)),
    "noise of": (lambda free, truth, _, std: ssim(noisy(free, std), truth), (0.01, 0.02, 0.03, 0.04, 0.05)),
    "value_range of": (lambda free, truth, _, by: ssim(free, truth, value_range=by), (0.05, 0.1, 0.2, 0.5)),
    "bfloat16": (lambda free, truth, *_: ssim(free.bfloat16(), truth.bfloat16()).float(), (0,)),
    "JPEG of quality": (lambda free, truth, _, q: ssim(jpeg(free, int(q)), truth), (10, 25, 50, 75)),
    "anti-aliased true maps": (lambda free, _, smooth, __: ssim(free, smooth), (0,)),
    "both resized by": (lambda free, truth, _, by: ssim(resized(free, by), resized(truth, by)), (0.5, 2)),
    "Gaussian window of": (
        lambda free, truth, _, px: ssim(free, truth, gaussian_kernel(int(px), 1.5 * px / 11)),
        (5, 7, 15, 21),
    ),
    "uniform window of": (lambda free, truth, _, px: ssim(free, truth, torch.full((int(px),), 1 / px)), (7, 11)),
    "threshold of": (lambda free, truth, _, at: ssim((free >= at).float(), truth), (THRESHOLD,)),
}


def averages() -> pd.DataFrame:
    """Return our and the paper's average SSIM by experiment and encoding, of the paper's four networks at 256 px."""
    runs = pd.read_csv(RESULTS / "workstation256" / "runs.csv", dtype={"experiment": str})
    ours = runs[runs["model"].isin(NETWORKS)].groupby(CELL)["ssim"].mean()
    paper = pd.read_csv(PAPER, dtype={"experiment": str})
    paper["encoding"] = paper["decay"].map({True: PROJECTION, False: PROJECTION_NO_DECAY})
    return pd.DataFrame({"ours": ours, "paper": paper.set_index(CELL)["ssim"]}).loc[CELLS]


def gap(both: pd.DataFrame) -> pd.DataFrame:
    """Fit a constant difference and a factor by least squares; rows of what is fitted, its value and the rms left."""
    ours, paper = both["ours"].to_numpy(), both["paper"].to_numpy()
    constant, factor = float((ours - paper).mean()), float(ours @ paper / (ours @ ours))
    fits = {"constant difference": (constant, ours - constant), "factor": (factor, factor * ours)}
    rows = [(name, value, float(np.sqrt(((fit - paper) ** 2).mean()))) for name, (value, fit) in fits.items()]
    return pd.DataFrame(rows, columns=["fitted", "value", "rms"])


def measured(outputs: Outputs, seed: int) -> Iterator[tuple[str, float, str, str, float]]:
    """Measure the mean SSIM of U-Net with every effect; rows of effect, level, experiment, encoding, ssim."""
    for experiment, encoding in CELLS:
        run = outputs.run(RunKey(experiment, "unet", encoding, seed))
        free = torch.from_numpy(read_predictions(run))[:, None]
        data, recordings = run.config().data, outputs.recordings(experiment)
        truth = load_recorded(recordings, "test", Grid(data.size_px, data.size_m)).maps.float()
        smooth = avg_pool2d(
            load_recorded(recordings, "test", Grid(FINE * data.size_px, data.size_m)).maps.float(), FINE
        )
        for effect, (apply, levels) in EFFECTS.items():
            for level in levels:
                yield effect, level, experiment, encoding, apply(free, truth, smooth, level).mean().item()


def transferred(rows: pd.DataFrame, both: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Change our averages by the ratio of the SSIM with and without each effect.

    Args:
        rows: see `measured`.
        both: see `averages`.

    Returns:
        the rows with the SSIM that follows and the paper's; rows of effect, level and the rms that is left.
    """
    plain = rows[rows["effect"] == "none"].set_index(CELL)["ssim"].rename("plain")
    effects = rows.merge(plain, left_on=CELL, right_index=True).merge(both, left_on=CELL, right_index=True)
    effects["expected"] = effects["ours"] * effects["ssim"] / effects["plain"]
    squared = (effects["expected"] - effects["paper"]) ** 2
    left = effects[["effect", "level"]].assign(rms=squared).groupby(["effect", "level"], sort=False).mean() ** 0.5
    return effects.drop(columns=["plain", "ours"]), left.reset_index()


def main() -> None:
    """Write the rows, what each effect leaves, the gap, and where they come from."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("outputs", type=Path)
    parser.add_argument("--recordings", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    outputs = Outputs(options.outputs, options.recordings or options.outputs / "recordings")
    TARGET.mkdir(parents=True, exist_ok=True)
    both = averages()
    rows = pd.DataFrame(measured(outputs, options.seed), columns=["effect", "level", *CELL, "ssim"])
    effects, left = transferred(rows, both)
    for name, table in (("gap", gap(both)), ("effects", effects), ("left", left)):
        write_text(TARGET / f"{name}.csv", table.to_csv(index=False, float_format="%.6g"))
    keys = [RunKey(experiment, "unet", encoding, options.seed) for experiment, encoding in CELLS]
    runs = {str(key.path): outputs.run(key).provenance().steps for key in keys}
    write_json(TARGET / "provenance.json", {"runs": runs, **environment()})
    print(gap(both).to_string(index=False), left.to_string(index=False), sep="\n\n")


if __name__ == "__main__":
    main()
