"""Test recordings with the predictions of every run, as gray PNGs in base64 for the HTML report."""

import base64
import io
from typing import Any

import numpy as np
from PIL import Image

from repro.config import PROJECTION
from repro.evaluation.evaluate import read_quantized
from repro.maps.projection import Projection
from repro.recordings.datasets import encoding_of, grid_of
from repro.recordings.reader import read_shards
from repro.recordings.recorded import true_maps
from repro.runs.directories import Run
from repro.runs.outputs import Outputs

Sample = dict[str, Any]
COUNT = 8  # recordings on the page, fewer if the first shard has fewer


def load_samples(outputs: Outputs, experiment: str, runs: list[Run]) -> list[Sample]:
    """Read the first recordings of the test split, one per world, with the inputs and predictions of some runs.

    Args:
        outputs: the outputs directory.
        experiment: the experiment.
        runs: evaluated runs of the experiment.

    Returns:
        for each recording: `index`, its index in the split; `truth`, the true map; `inputs`, the image of each encoding
        by its label, the paper's projection for one with several images and for baselines alone; `predictions`, the
        probability of free by the path of each run. Images are PNG in base64.
    """
    shard = next(read_shards(outputs.recordings(experiment), "test"))
    chosen = np.arange(0, len(shard.scans), 2)[:COUNT]
    scans = shard.scans[: 2 * COUNT : 2].tensors()
    grid = grid_of(runs[0].config())
    truth = true_maps(shard, grid).numpy()[chosen] * 255
    inputs, predictions = {}, {}
    for run in runs:
        config = run.config()
        predictions[str(run.path.relative_to(outputs.path))] = read_quantized(run)[chosen]
        if config.encoding and config.encoding.label not in inputs:
            encoding = encoding_of(config)
            shown = encoding if encoding.channels == 1 else Projection()
            inputs[config.encoding.label] = shown.encode(scans, grid)[:, 0].numpy()
    if not inputs:
        inputs[PROJECTION] = Projection().encode(scans, grid)[:, 0].numpy()
    return [
        {
            "index": int(index),
            "truth": png(truth[number]),
            "inputs": {name: png(images[number]) for name, images in inputs.items()},
            "predictions": {name: png(images[number]) for name, images in predictions.items()},
        }
        for number, index in enumerate(chosen)
    ]


def png(gray: np.ndarray) -> str:
    """Encode a gray image (H, W), uint8, as PNG in base64."""
    buffer = io.BytesIO()
    Image.fromarray(gray).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()
