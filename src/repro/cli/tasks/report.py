"""task=report: tables and figures from the runs that are there."""

import sys

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the tables and the figures.

    Raises:
        InputError: there is nothing to report, or some runs are damaged; everything else is written.
    """
    from repro.cli.output import print_tables
    from repro.system.errors import InputError

    outputs = job.outputs
    if not any(outputs.runs()) and not outputs.recorded():
        raise InputError(f"{outputs.path} holds no recordings and no runs: make some first, or set outputs=")
    errors = print_tables(outputs, ())
    from repro.cli.figures import draw_figures  # imports torch and IR-SIM, some seconds

    print("drawing the figures", flush=True)
    left_out = draw_figures(outputs)
    for error in left_out:
        print(f"error: left out of the figures: {error}", file=sys.stderr)
    if errors or left_out:
        raise InputError(f"{len(errors + left_out)} runs are left out of the tables or figures, see above")


TASK = Task(run, once=True)
