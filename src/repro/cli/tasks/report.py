"""task=report: tables and figures from the runs that are there."""

import itertools
import sys

from repro.cli.jobs import Job
from repro.cli.output import print_tables
from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.evaluation.examples import load_example
from repro.recordings.format import SPLITS
from repro.recordings.reader import read_manifest
from repro.reporting.figures import write_figures
from repro.reporting.uptodate import inputs_hash, is_up_to_date, mark_up_to_date
from repro.runs.keys import RunKey
from repro.simulation.worlds import sample_world


def run(job: Job) -> None:
    """Write tables and figures.

    Raises:
        ValueError: some runs cannot be trusted; everything else is written.
    """
    outputs = job.outputs
    errors = print_tables(outputs, ())
    inputs = inputs_hash(outputs)
    if not errors and is_up_to_date(outputs.figures, inputs):
        print(f"Figures are up to date: {outputs.figures}")
        return
    specs = {experiment: read_manifest(path).spec for experiment, path in outputs.recorded().items()}
    worlds = {experiment: sample_world(spec, SPLITS["test"]) for experiment, spec in specs.items()}
    examples = []
    for encoding, experiment in itertools.product((PROJECTION, PROJECTION_NO_DECAY), specs):
        key = RunKey(experiment, "unet", encoding, 0)
        try:
            if outputs.run(key).is_evaluated:
                examples.append(load_example(outputs, key))
        except ValueError as error:
            print(f"error: left out of the figures: {error}", file=sys.stderr)
            errors.append(str(error))
    for path in write_figures(outputs.figures, worlds, examples):
        print(f"Figure: {path}", flush=True)
    mark_up_to_date(outputs.figures, inputs)
    if errors:
        raise ValueError(f"{len(errors)} runs are left out of the tables or figures, see above")
