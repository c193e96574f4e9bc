"""Test recordings with what every network makes of them, small enough for a page: gray PNGs as base64."""

import base64
import io
from typing import Any

import numpy as np
import torch
from PIL import Image

from repro.evaluation.evaluate import read_quantized
from repro.maps.datasets import encoding_of, grid_of, true_maps
from repro.recordings.reader import read_shards
from repro.runs.directories import Outputs, Run

Sample = dict[str, Any]


def load_samples(outputs: Outputs, experiment: str, runs: list[Run], count: int = 8) -> list[Sample]:
    """Reads the first recordings of the test split, one of each world, with the inputs and predictions of some runs.

    Args:
        outputs: the outputs directory.
        experiment: the experiment.
        runs: evaluated runs of it.
        count: how many recordings, at most those of the first shard.

    Returns:
        for each: `index`, its number in the split; `truth`, the true map; `inputs`, the image of each encoding by its
        variant; `predictions`, the probability of free by each run's place. Images are PNG in base64.
    """
    shard = next(read_shards(outputs.recordings(experiment), "test"))
    chosen = np.arange(0, len(shard.scans), 2)[:count]
    grid = grid_of(runs[0].config())
    truth = true_maps(shard, grid).numpy()[chosen] * 255
    inputs, predictions = {}, {}
    for run in runs:
        config = run.config()
        predictions[str(run.path.relative_to(outputs.path))] = read_quantized(run)[chosen]
        if config.encoding and config.encoding.label not in inputs:
            images = encoding_of(config).encode(shard.scans.tensors(), grid)
            inputs[config.encoding.label] = images[torch.as_tensor(chosen), -1].numpy()
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
    """Writes a gray image (H, W), uint8, as PNG in base64."""
    buffer = io.BytesIO()
    Image.fromarray(gray).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()
