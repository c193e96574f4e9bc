"""task=report: tables and figures from the runs that are there."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the tables and the figures.

    Raises:
        InputError: there is nothing to report, or a run is damaged.
    """
    print(f"reading {job.outputs.path}", flush=True)
    from repro.cli.output import print_tables
    from repro.system.errors import InputError

    outputs = job.outputs
    if not any(run.has_begun for run in outputs.runs()) and not outputs.recorded():
        raise InputError(f"{outputs.path} holds no recordings and no runs: make some first, or set outputs=")
    print_tables(outputs, ())
    from repro.cli.paper_figures import draw_figures  # imports torch and IR-SIM, some seconds

    print("drawing the figures", flush=True)
    draw_figures(outputs)


TASK = Task(run, once=True)
