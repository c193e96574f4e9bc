"""One test recording with what a network makes of it, as arrays for a figure or a page."""

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
        encoding: label of the encoding, the paper's projection or that of its ablation.
        projection: gray image, 0 black to 255 white, (H, W).
        prediction: probability of free, (H, W).
        truth: true map, 1 is free, (H, W).
        scans: the recording itself, ranges (T, N).
        oldest_gray: gray of the oldest hit, 1 is white.
    """

    experiment: str
    encoding: str
    projection: np.ndarray
    prediction: np.ndarray
    truth: np.ndarray
    scans: Scans
    oldest_gray: float


def load_example(outputs: Outputs, key: RunKey, index: int = 0) -> Example:
    """Reads one test recording: what went into a network of seed 0, what came out, what was true.

    Args:
        outputs: an outputs directory with this network evaluated.
        key: the run.
        index: which recording of the test split.

    Raises:
        ValueError: the run is not there, or there is no such recording.
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
