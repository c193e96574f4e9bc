"""task=world: one world and its twin as plain IR-SIM YAML, with a figure or animation; or a world that has a floor.

With `animate`, the network of seed 0 predicts the world step by step. With `floor_map`, the floor of a map of
map_server becomes a file of conf/world. No network is trained on the worlds of this task, see
`recordings.format.SHOWN_SEED`.
"""

from dataclasses import replace
from typing import Any

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the world of the seed, its twin and the figure, or the world that has the floor of a map.

    Raises:
        InputError: the network of an animation is not trained.
    """
    if job.call.floor_map:
        from repro.cli.floors import write_floor

        write_floor(job.call.floor_map)
        return
    from repro.recordings.format import SHOWN_SEED
    from repro.reporting.figures import write_world_figure
    from repro.simulation.worlds import reverse_direction, sample_world, write_world

    world = sample_world(job.spec, SHOWN_SEED + job.call.seed)
    stem = f"exp{job.key.experiment}-seed{job.call.seed}"
    if job.call.animate:
        _animate(job, world, stem)
        return
    figure = job.outputs.worlds / f"{stem}.png"
    for name, item in (("ccw", world), ("cw", reverse_direction(world))):
        path = job.outputs.worlds / f"{stem}-{name}.yaml"
        write_world(item, path)
        print(path)
    write_world_figure(world, job.key.experiment, figure)
    print(figure)


def _animate(job: Job, world: Any, stem: str) -> None:
    from repro.cli.tasks.export import suffix_of
    from repro.networks.predictor import load_predictor
    from repro.reporting.animation import make_frames, write_animation
    from repro.simulation.simulator import simulate
    from repro.system.errors import InputError

    key = replace(job.key, seed=0)  # the seed of the call is that of the world
    trained = job.outputs.run(key)
    if not trained.is_trained:
        raise InputError(f"{trained} is not trained: train it first, with the same options and seed=0")
    trained.check(replace(job.config, seed=0))
    print(f"simulating and drawing world {job.call.seed} of experiment {key.experiment}", flush=True)
    recording = simulate(world)
    frames = make_frames(recording, load_predictor(trained.model))
    model = "" if key.model == "unet" else f"-{key.model}"
    path = job.outputs.worlds / f"{stem}{model}{suffix_of(key)}.gif"
    path.parent.mkdir(parents=True, exist_ok=True)
    size_m, range_max_m = job.spec.world.width, job.spec.lidar.range_max
    write_animation(recording, frames, path, size_m=size_m, range_max_m=range_max_m)
    print(path)


TASK = Task(run, names_scale=False, own=("floor_map", "animate"))
