"""The paper's figures from the runs of an outputs directory."""

import itertools
from collections.abc import Iterator

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.recordings.format import SPLITS
from repro.recordings.reader import read_manifest
from repro.reporting.figures import load_example, write_figures
from repro.runs.keys import RunKey, lowest_seeds
from repro.runs.outputs import Outputs
from repro.simulation.worlds import sample_world
from repro.system.errors import InputError


def draw_figures(outputs: Outputs) -> list[str]:
    """Write the figures, print their paths, and return why runs were left out."""
    errors, worlds, examples = [], {}, []
    for experiment, path in outputs.recorded().items():
        try:
            worlds[experiment] = sample_world(read_manifest(path).world_spec, SPLITS["test"])
        except InputError as error:
            errors.append(str(error))
    for encoding, experiment in itertools.product((PROJECTION, PROJECTION_NO_DECAY), worlds):
        try:
            for key in lowest_seeds(_evaluated(outputs, experiment, encoding)):
                examples.append(load_example(outputs, key))
        except InputError as error:
            errors.append(str(error))
    for path in write_figures(outputs.figures, worlds, examples):
        print(f"Figure: {path}", flush=True)
    return errors


def _evaluated(outputs: Outputs, experiment: str, encoding: str) -> Iterator[RunKey]:
    """Yield the keys of the evaluated U-Nets of an experiment with an encoding."""
    for key, run in outputs.named_runs()[0].items():
        if (key.experiment, key.model, key.encoding) == (experiment, "unet", encoding) and run.is_evaluated:
            yield key
