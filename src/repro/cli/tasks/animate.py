"""task=animate: an animation of the world of one seed, predicted step by step by the network of seed 0.

The world is that of task=world, on which no network is trained.
"""

from dataclasses import replace

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the animation.

    Raises:
        InputError: the network is not trained.
    """
    from repro.cli.tasks.export import suffix_of
    from repro.networks.predictor import load_predictor
    from repro.recordings.format import SHOWN_SEED
    from repro.reporting.animation import make_frames, write_animation
    from repro.simulation.simulator import simulate
    from repro.simulation.worlds import sample_world
    from repro.system.errors import InputError

    key = replace(job.key, seed=0)  # the seed of the call is that of the world
    trained = job.outputs.run(key)
    if not trained.is_trained:
        raise InputError(f"{trained} is not trained: train it first, with the same options and seed=0")
    trained.check(replace(job.config, seed=0))
    world = sample_world(job.spec, SHOWN_SEED + job.call.seed)
    print(f"simulating and drawing world {job.call.seed} of experiment {key.experiment}", flush=True)
    recording = simulate(world)
    frames = make_frames(recording, load_predictor(trained.model))
    model = "" if key.model == "unet" else f"-{key.model}"
    path = job.outputs.worlds / f"exp{key.experiment}-seed{job.call.seed}{model}{suffix_of(key)}.gif"
    path.parent.mkdir(parents=True, exist_ok=True)
    size_m, range_max_m = job.spec.world.width, job.spec.lidar.range_max
    write_animation(recording, frames, path, size_m=size_m, range_max_m=range_max_m)
    print(path)


TASK = Task(run)
