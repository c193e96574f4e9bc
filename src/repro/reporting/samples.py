"""Test recordings with their predictions: one as arrays for figures, several as JSON for the HTML report."""

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jinja2.utils import htmlsafe_json_dumps
from PIL import Image

from repro.baselines.names import rank
from repro.config import PROJECTION
from repro.evaluation.evaluate import read_predictions, read_quantized
from repro.maps.projection import Projection
from repro.recordings.datasets import encoding_of, grid_of
from repro.recordings.reader import read_recording, read_shards
from repro.recordings.recorded import true_maps
from repro.reporting.names import experiment_title, predictor_title
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.scans import Scans
from repro.system.errors import InputError

COUNT = 8  # recordings on the page, fewer if the first shard has fewer


@dataclass(frozen=True)
class Example:
    """A test recording and its prediction.

    Args:
        experiment: the experiment.
        encoding: label of the encoding, the paper's projection or its ablation.
        projection: gray image, 0 black to 255 white, (H, W).
        prediction: probability of free, (H, W).
        truth: true map, 1 is free, (H, W).
        scans: the scans of the recording, ranges (T, N).
        oldest_gray: gray value of the oldest hit, 1 is white.
    """

    experiment: str
    encoding: str
    projection: np.ndarray
    prediction: np.ndarray
    truth: np.ndarray
    scans: Scans
    oldest_gray: float


def load_example(outputs: Outputs, key: RunKey, index: int = 0) -> Example:
    """Read one test recording with its input image, the prediction of a run and the true map.

    Args:
        outputs: an outputs directory with this network evaluated.
        key: key of the run.
        index: index of the recording in the test split.

    Raises:
        ValueError: the run or the recording does not exist, or the run is a baseline.
    """
    run, recordings = outputs.run(key), outputs.recordings(key.experiment)
    config = run.config()
    if config.encoding is None:
        raise InputError(f"{run} is a baseline, which has no encoding")
    shard, at = read_recording(recordings, "test", index)
    grid = grid_of(config)
    return Example(
        key.experiment,
        key.encoding,
        encoding_of(config).encode(shard.scans[at : at + 1].tensors(), grid)[0, 0].numpy(),
        read_predictions(run)[index],
        true_maps(shard, grid)[at].numpy(),
        shard.scans[at],
        config.encoding.parameters["oldest_gray"],
    )


def samples_json(outputs: Outputs, runs: Mapping[str, list[Run]]) -> str:
    """Return samples of the evaluated runs of each experiment as JSON for a script element; empty without runs."""
    experiments = [
        {"name": experiment_title(experiment, ": {}"), "samples": load_samples(outputs, experiment, own)}
        for experiment, own in runs.items()
    ]
    return htmlsafe_json_dumps({"experiments": experiments}) if experiments else ""


def load_samples(outputs: Outputs, experiment: str, runs: list[Run]) -> list[dict[str, Any]]:
    """Read the first recordings of the test split, one per world, with the inputs and predictions of some runs.

    Returns:
        for each recording: `name`; `truth`, the true map; `inputs`, the image of each encoding by its label, the
        paper's projection for one with several images and for baselines alone; `predictions`, by the path of each run
        in the order of the tables: `name`, `input` (its label) and `image`, the probability of free. Images are PNG in
        base64.
    """
    shard = next(read_shards(outputs.recordings(experiment), "test"))
    chosen = np.arange(0, len(shard.scans), 2)[:COUNT]
    scans, grid = shard.scans[: 2 * COUNT : 2].tensors(), grid_of(runs[0].config())
    truth = true_maps(shard, grid).numpy()[chosen] * 255
    inputs: dict[str, np.ndarray] = {}
    predictions: dict[str, tuple[RunKey, np.ndarray]] = {}
    for run in sorted(runs, key=lambda run: (rank(run.config().model.name), str(run.path))):
        config = run.config()
        predictions[str(run.path.relative_to(outputs.path))] = config.key, read_quantized(run)[chosen]
        if config.encoding and config.encoding.label not in inputs:
            encoding = encoding_of(config)
            shown = encoding if encoding.channels == 1 else Projection()
            inputs[config.encoding.label] = shown.encode(scans, grid)[:, 0].numpy()
    inputs = inputs or {PROJECTION: Projection().encode(scans, grid)[:, 0].numpy()}
    return [
        {
            "name": f"test recording {index}",
            "truth": png(truth[number]),
            "inputs": {name: png(images[number]) for name, images in inputs.items()},
            "predictions": {
                path: {
                    "name": predictor_title(key.model, key.encoding),
                    "input": key.encoding or next(iter(inputs)),
                    "image": png(images[number]),
                }
                for path, (key, images) in predictions.items()
            },
        }
        for number, index in enumerate(chosen)
    ]


def png(gray: np.ndarray) -> str:
    """Encode a gray image (H, W), uint8, as PNG in base64."""
    buffer = io.BytesIO()
    Image.fromarray(gray).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()
