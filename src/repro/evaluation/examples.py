"""One test recording with the prediction of a network, as arrays for figures."""

from dataclasses import dataclass

import numpy as np

from repro.evaluation.evaluate import read_predictions
from repro.maps.datasets import load_pairs_of_run
from repro.recordings.reader import read_scans
from repro.runs.directories import Outputs
from repro.runs.keys import RunKey
from repro.scans import Scans


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
        raise ValueError(f"{run} is a baseline, which has no encoding")
    scans = read_scans(recordings, "test", index)
    pairs = load_pairs_of_run(recordings, "test", config, "cpu")
    return Example(
        key.experiment,
        key.encoding,
        pairs.images[index, 0].numpy(),
        read_predictions(run)[index],
        pairs.maps[index, 0].numpy(),
        scans,
        config.encoding.parameters["oldest_gray"],
    )
