"""The paper's tables and figures from the runs of an outputs directory."""

import itertools

from repro.recordings.format import SPLITS
from repro.recordings.reader import open_recordings
from repro.reporting.figures import load_example, write_figures
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.keys import lowest_seeds
from repro.runs.outputs import Outputs
from repro.simulation.sampling import sample_world


def draw_figures(outputs: Outputs) -> None:
    """Write the figures and print their paths."""
    recorded = outputs.recorded()
    worlds = {name: sample_world(open_recordings(path).spec, SPLITS["test"]) for name, path in recorded.items()}
    evaluated = [run.config().key for run in outputs.runs() if run.is_evaluated]
    shown = {(key.encoding, key.experiment): key for key in lowest_seeds(evaluated) if key.model == "unet"}
    cells = itertools.product((PROJECTION, PROJECTION_NO_DECAY), worlds)
    examples = [load_example(outputs, shown[cell]) for cell in cells if cell in shown]
    for path in write_figures(outputs.figures, worlds, examples):
        print(f"Figure: {path}", flush=True)
