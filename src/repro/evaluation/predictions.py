"""Evaluates a trained network, and the two simple predictors to compare it with, on the test set.

Run directory in, run directory out: predictions, the pooled metrics and one row an image. Whatever metric is
wanted later is computed from the predictions kept there.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor
from torch.nn import functional as F

from repro.evaluation.metrics import confusion, scores, ssim
from repro.learning.models import load_model, resolve_device
from repro.maps.datasets import Pairs, load_pairs_of_run
from repro.runs import lock, read_config, read_status, replace_file, write_provenance
from repro.simulation.store import check_recordings

BASELINES = ("all_free", "last_seen")


def evaluate(run: Path, recordings: Path, *, accelerator: str = "auto") -> pd.Series:
    """Evaluates the best weights of a finished run on the test set.

    Args:
        run: a run directory whose training is finished.
        recordings: the recorded experiment it was trained on.
        accelerator: auto, cpu or gpu.

    Returns:
        the pooled metrics, as in metrics.csv.

    Raises:
        ValueError: the run is not finished, or the recordings are not those it was trained on.
    """
    with lock(run):
        if read_status(run) == "evaluated":
            return _read(run)
        test, probability = _predict_split("test", run, recordings, accelerator)
        return _write(run, probability, test)


def validate(run: Path, recordings: Path, *, accelerator: str = "auto") -> pd.Series:
    """Measures the best weights of a finished run on the validation set and writes validation.csv.

    Worlds are calibrated by these numbers, so that nothing is ever chosen on test data.

    Args:
        run: a run directory whose training is finished.
        recordings: the recorded experiment it was trained on.
        accelerator: auto, cpu or gpu.

    Returns:
        the pooled metrics, as `evaluate` returns them for the test set.

    Raises:
        ValueError: the run is not finished, or the recordings are not those it was trained on.
    """
    with lock(run):
        val, probability = _predict_split("val", run, recordings, accelerator)
        row, _ = _measure(probability, val)
        _write_row(row, run / "validation.csv")
        return row


def evaluate_baseline(run: Path, recordings: Path) -> pd.Series:
    """Evaluates `all_free` or `last_seen`, whichever the run's config names as its model, on the test set.

    `all_free` predicts that there is no obstacle. `last_seen` predicts one wherever a hit lies within a
    radius, the one that is best on the validation set.
    """
    with lock(run):
        if read_status(run) == "evaluated":
            return _read(run)
        check_recordings(run, recordings)
        config = read_config(run)
        test = load_pairs_of_run(recordings, "test", config, "cpu")
        if config["model"]["name"] == "all_free":
            return _write(run, torch.ones(test.maps.shape), test)
        val = load_pairs_of_run(recordings, "val", config, "cpu")
        radius = best_radius(val)
        return _write(run, last_seen(test, radius), test, radius_px=radius)


@torch.inference_mode()
def predict(model: torch.nn.Module, pairs: Pairs, batch: int = 32) -> Tensor:
    """Probability of free for every pair, (M, 1, H, W), on the CPU."""
    model.eval()
    index = torch.arange(len(pairs), device=pairs.images.device)
    return torch.cat([torch.sigmoid(model(pairs.batch(part)[0])).cpu() for part in index.split(batch)])


def best_radius(pairs: Pairs, largest_px: int = 8) -> int:
    """Radius of `last_seen`, of 0 to `largest_px` pixels, with the best obstacle IoU."""
    truth = pairs.maps.float()
    radii = range(largest_px + 1)
    return int(np.argmax([scores(confusion(last_seen(pairs, r), truth).sum(0))["obstacle_iou"] for r in radii]))


def last_seen(pairs: Pairs, radius_px: int) -> Tensor:
    """Map with an obstacle wherever a hit lies within `radius_px` pixels, (M, 1, H, W); 1 is free."""
    hit = (pairs.images < 255).float()
    reach = torch.arange(-radius_px, radius_px + 1)
    disc = (reach[:, None] ** 2 + reach**2 <= radius_px**2).float()
    return (F.conv2d(hit, disc[None, None], padding=radius_px) == 0).float()


def read_predictions(run: Path) -> np.ndarray:
    """Reads the kept probabilities of free, (M, H, W), float32 in [0, 1]."""
    with np.load(run / "predictions.npz", allow_pickle=False) as file:
        return file["free"].astype(np.float32) / 255


def _read(run: Path) -> pd.Series:
    return pd.read_csv(run / "metrics.csv").iloc[0]


def _predict_split(split: str, run: Path, recordings: Path, accelerator: str) -> tuple[Pairs, Tensor]:
    """The pairs of a split and what the best weights of a finished run predict for them."""
    if read_status(run) not in ("finished", "evaluated"):
        raise ValueError(f"{run} is not trained to its end: train it with task=train first")
    check_recordings(run, recordings)
    device = resolve_device(accelerator)
    pairs = load_pairs_of_run(recordings, split, read_config(run), device)
    return pairs, predict(load_model(run / "model").to(device), pairs)


def _measure(probability: Tensor, pairs: Pairs) -> tuple[pd.Series, pd.DataFrame]:
    """The pooled metrics of predictions, and one row an image."""
    truth = pairs.maps.cpu().float()
    counts, similarity = confusion(probability, truth), ssim(probability, truth)
    binary = ssim((probability > 0.5).float(), truth)
    per_image = pd.DataFrame(
        {"ssim": similarity, "ssim_binary": binary, **{k: v.numpy() for k, v in scores(counts).items()}}
    )
    pooled = {name: value.item() for name, value in scores(counts.sum(0)).items()}
    return pd.Series({"ssim": similarity.mean().item(), "ssim_binary": binary.mean().item(), **pooled}), per_image


def _write_row(row: pd.Series, path: Path) -> None:
    replace_file(path, row.to_frame().T.to_csv(index=False, float_format="%.6f"))


def _write(run: Path, probability: Tensor, test: Pairs, **facts: Any) -> pd.Series:
    """Measures predictions for the test set and writes them with their metrics into the run directory."""
    row, per_image = _measure(probability, test)
    free = (probability * 255).round().to(torch.uint8).squeeze(1).numpy()
    np.savez_compressed(run / "predictions.npz", free=free)
    per_image.rename_axis("image").to_csv(run / "per_image.csv", float_format="%.6f")
    _write_row(row, run / "metrics.csv")
    write_provenance(run, status="evaluated", test_pairs=len(test), **facts)
    return row
