"""task=report: tables and figures from the runs that are there."""

import sys

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the tables, and the figures unless they are up to date.

    Raises:
        InputError: there is nothing to report, or some runs are damaged; everything else is written.
    """
    from repro.cli.inputs import inputs_hash, is_up_to_date, mark_up_to_date
    from repro.cli.output import print_tables
    from repro.system.errors import InputError

    outputs = job.outputs
    if not any(outputs.runs()) and not outputs.recorded():
        raise InputError(f"{outputs.path} holds no recordings and no runs: make some first, or set outputs=")
    errors = print_tables(outputs, ())
    inputs = inputs_hash(outputs)
    if not errors and is_up_to_date(outputs.figures, inputs):
        print(f"Figures are up to date: {outputs.figures}")
        return
    from repro.cli.figures import draw_figures  # imports torch and IR-SIM, some seconds

    print("drawing the figures", flush=True)
    left_out = draw_figures(outputs)
    for error in left_out:
        print(f"error: left out of the figures: {error}", file=sys.stderr)
    if errors or left_out:
        raise InputError(f"{len(errors + left_out)} runs are left out of the tables or figures, see above")
    mark_up_to_date(outputs.figures, inputs)


TASK = Task(run, once=True)
