"""Evaluation of a network or a baseline on the test set.

The run directory receives the quantized predictions, the pooled metrics and one row of metrics per image. All later
analyses are computed from the stored predictions.
"""

import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.baselines.registry import PREDICTORS
from repro.evaluation.image_metrics import IMAGE_METRICS, IN_INTERVALS, of_images
from repro.learning.networks.trained import load_trained
from repro.metrics.counts import counts_of, pooled_scores, quantize
from repro.metrics.scores import checked_probabilities
from repro.recordings.datasets import grid_of, load_pairs_of_run
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import load_recorded
from repro.runs.config import RunConfig
from repro.runs.devices import resolve_device
from repro.runs.directories import Run, read_table
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.system.arrays import open_arrays
from repro.system.errors import InputError
from repro.system.files import replacing, sha256, write_text
from repro.system.progress import say

FILES = ("predictions.npz", "per_image.csv", "metrics.csv")  # written together; their checksums are in the provenance


def evaluate(run: Run, recordings: Path, *, accelerator: str = "auto") -> pd.Series:
    """Evaluate a run on the test set: a baseline or the best weights of a trained network.

    Args:
        recordings: the recorded experiment it was trained on.
        accelerator: auto, cpu or gpu; baselines always run on the CPU.

    Returns:
        the pooled metrics, as in metrics.csv.

    Raises:
        InputError: the run is not trained, or the recordings are not those it was trained on.
    """
    with run.exclusive():
        if run.is_evaluated:
            return run.read_metrics()
        config = run.config()
        facts: dict[str, Any] = {}
        if not config.key.is_baseline:
            run.check_trained()
        opened = open_recordings(recordings)
        opened.check_worlds(config.data.worlds)
        run.use_recordings(opened.hash(asdict(config.data.pairs)))
        if config.key.is_baseline:
            val, recorded = (load_recorded(opened, split, grid_of(config)) for split in ("val", "test"))
            maps, (probability, facts) = recorded.maps, PREDICTORS[config.model.name](val, recorded)
        else:
            device = resolve_device(accelerator)
            pairs = load_pairs_of_run(opened, "test", config, device)
            maps = pairs.maps.numpy(force=True)
            probability = load_trained(run.model, device).predict_images(pairs.image_batches(32))
        try:
            row, per_image = measure(probability, maps)
        except InputError as error:
            raise InputError(f"{run}: {error}") from error
        write_predictions(run, probability)
        write_text(run.path / "per_image.csv", per_image.rename_axis("image").to_csv(float_format="%.6f"))
        write_text(run.metrics, row.to_frame().T.to_csv(index=False, float_format="%.6f"))
        files = {name: sha256(run.path / name) for name in FILES}
        run.begin_step("evaluated", Status.evaluated, test_pairs=len(maps), **facts, files=files)
        return row


def evaluate_baseline(outputs: Outputs, config: RunConfig, name: str) -> None:
    """Evaluate a baseline on the worlds and the grid of a run, unless it is evaluated already."""
    config, recordings = config.of_baseline(name), outputs.recordings(config.experiment)
    run = outputs.run(config.key)
    if not run.is_evaluated:
        open_recordings(recordings).check_worlds(config.data.worlds)
        say(f"evaluating {run}")
    run.prepare(config)
    evaluate(run, recordings)


def measure(free: np.ndarray, maps: np.ndarray) -> tuple[pd.Series, pd.DataFrame]:
    """Measure predictions (M, 1, H, W) against true maps; return the pooled metrics and one row per image.

    Raises:
        InputError: see `checked_probabilities` and `of_images`.
    """
    probability = checked_probabilities(free, maps)
    counts = counts_of(probability, maps)
    measured = {name: of_images(name, probability, maps) for name in IMAGE_METRICS}
    per_image = pd.DataFrame(measured | pooled_scores(counts))
    means = {name: values.mean() for name, values in measured.items()}
    return pd.Series((means | pooled_scores(counts.sum(0))), dtype=float), per_image


def read_per_image(run: Run) -> dict[str, np.ndarray]:
    """Read the metrics in `IN_INTERVALS` of every test image of an evaluated run, each (M,).

    Raises:
        InputError: per_image.csv cannot be read.
    """
    table = read_table(run.check_file("per_image.csv"), IN_INTERVALS, run.evaluate_again)
    return {name: table[name].to_numpy() for name in IN_INTERVALS}


def write_predictions(run: Run, probability: np.ndarray) -> None:
    """Write the probabilities of free (M, 1, H, W), quantized to uint8."""
    free = quantize(probability)
    with replacing(run.path / "predictions.npz") as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, free=free)


def read_predictions(run: Run) -> np.ndarray:
    """Read the stored probabilities of free, (M, H, W), float32 in [0, 1]; see `read_quantized`."""
    return read_quantized(run).astype(np.float32) / 255


def read_quantized(run: Run) -> np.ndarray:
    """Read the quantized probabilities of free, (M, H, W), uint8, 255 for 1.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    path = run.check_file("predictions.npz")
    try:
        with open_arrays(path) as file:
            return file["free"]
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} cannot be read ({error}): {run.evaluate_again}") from error
