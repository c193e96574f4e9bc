"""One test recording with what a network makes of it, as arrays for a figure or a page."""

from dataclasses import dataclass

import numpy as np

from repro.evaluation.predictions import read_predictions
from repro.maps.datasets import load_pairs_of_run
from repro.runs import Outputs
from repro.scans import Scans
from repro.simulation.store import read_scans


@dataclass(frozen=True)
class Example:
    """A test recording and its prediction.

    Args:
        experiment: the experiment.
        decay: whether the projection fades with age.
        projection: gray image, 0 black to 255 white, (H, W).
        prediction: probability of free, (H, W).
        truth: true map, 1 is free, (H, W).
        scans: the recording itself, ranges (T, N).
        oldest_gray: gray of the oldest hit, 1 is white.
    """

    experiment: str
    decay: bool
    projection: np.ndarray
    prediction: np.ndarray
    truth: np.ndarray
    scans: Scans
    oldest_gray: float


def load_example(outputs: Outputs, experiment: str, *, decay: bool, model: str = "unet", index: int = 0) -> Example:
    """Reads one test recording: what went into a network of seed 0, what came out, what was true.

    Args:
        outputs: an outputs directory with this network evaluated.
        experiment: the experiment.
        decay: with the paper's projection, or that of its ablation.
        model: the network.
        index: which recording of the test split.

    Raises:
        ValueError: the run is not there, or there is no such recording.
    """
    run = outputs.run(experiment, model, "decay" if decay else "no-decay", 0)
    recordings = outputs.recordings(experiment)
    config = run.config()
    scans = read_scans(recordings, "test", index)
    pairs = load_pairs_of_run(recordings, "test", config, "cpu")
    return Example(
        experiment,
        decay,
        pairs.images[index, 0].numpy(),
        read_predictions(run)[index],
        pairs.maps[index, 0].numpy(),
        scans,
        config.encoding.parameters["oldest_gray"],
    )
