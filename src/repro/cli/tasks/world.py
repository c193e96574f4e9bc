"""task=world: write the world of one seed, in both directions, as plain IR-SIM YAML, and a figure of it.

No network is trained on these worlds, see `recordings.format.SHOWN_SEED`.
"""

from repro.cli.jobs import Job
from repro.recordings.format import SHOWN_SEED
from repro.reporting.figures import write_world_figure
from repro.simulation.worlds import reverse_direction, sample_world, write_world


def run(job: Job) -> None:
    """Write the world, its twin and the figure, and print their paths."""
    world = sample_world(job.spec, SHOWN_SEED + job.call.seed)
    figure = job.outputs.worlds / f"exp{job.key.experiment}-seed{job.call.seed}.png"
    for name, item in (("ccw", world), ("cw", reverse_direction(world))):
        path = job.outputs.worlds / f"exp{job.key.experiment}-seed{job.call.seed}-{name}.yaml"
        write_world(item, path)
        print(path)
    write_world_figure(world, job.key.experiment, figure)
    print(figure)
