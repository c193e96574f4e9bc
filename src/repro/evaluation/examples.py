"""One test recording with the prediction of a network, as arrays for figures."""

from dataclasses import dataclass

import numpy as np

from repro.evaluation.evaluate import read_predictions
from repro.recordings.datasets import encoding_of, grid_of
from repro.recordings.reader import read_recording
from repro.recordings.recorded import true_maps
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.scans import Scans
from repro.system.errors import InputError


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
