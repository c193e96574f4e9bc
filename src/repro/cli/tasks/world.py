"""task=world: one world and its twin as plain IR-SIM YAML, with a figure.

No network is trained on the worlds of this task, see `recordings.format.SHOWN_SEED`.
"""

from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the world of the seed, its twin and the figure."""
    print("sampling the world, after IR-SIM is loaded", flush=True)
    from repro.recordings.format import SHOWN_SEED
    from repro.reporting.figures import write_world_figure
    from repro.simulation.sampling import reverse_direction, sample_world, write_world

    world = sample_world(job.spec, SHOWN_SEED + job.call.seed)
    stem = _target(job).name
    figure = job.outputs.worlds / f"{stem}.png"
    for name, item in (("ccw", world), ("cw", reverse_direction(world))):
        path = job.outputs.worlds / f"{stem}-{name}.yaml"
        write_world(item, path)
        print(path)
    write_world_figure(world, job.key.experiment, figure)
    print(figure)


def _target(job: Job) -> Path:
    return job.outputs.worlds / f"exp{job.key.experiment}-seed{job.call.seed}"


TASK = Task(run, target=_target, names_scale=False)
