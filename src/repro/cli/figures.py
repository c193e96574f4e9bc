"""The paper's figures from the runs of an outputs directory."""

import itertools

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.evaluation.examples import load_example
from repro.recordings.format import SPLITS
from repro.recordings.reader import read_manifest
from repro.reporting.figures import write_figures
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.simulation.worlds import sample_world


def draw_figures(outputs: Outputs) -> list[str]:
    """Write the figures, print their paths, and return why runs were left out."""
    errors, worlds, examples = [], {}, []
    for experiment, path in outputs.recorded().items():
        try:
            worlds[experiment] = sample_world(read_manifest(path).spec, SPLITS["test"])
        except ValueError as error:
            errors.append(str(error))
    for encoding, experiment in itertools.product((PROJECTION, PROJECTION_NO_DECAY), worlds):
        try:
            if key := lowest_seed(outputs, experiment, encoding):
                examples.append(load_example(outputs, key))
        except ValueError as error:
            errors.append(str(error))
    for path in write_figures(outputs.figures, worlds, examples):
        print(f"Figure: {path}", flush=True)
    return errors


def lowest_seed(outputs: Outputs, experiment: str, encoding: str) -> RunKey | None:
    """Return the evaluated run of U-Net with the lowest seed; None without any."""
    keys = [RunKey.parse(run.path.relative_to(outputs.path)) for run in outputs.runs()]
    mine = [key for key in keys if (key.experiment, key.model, key.encoding) == (experiment, "unet", encoding)]
    return next((key for key in sorted(mine, key=lambda key: key.seed or 0) if outputs.run(key).is_evaluated), None)
