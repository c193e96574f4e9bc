"""What a user should know before a call runs: the scale where it was not chosen, what it costs, and warnings."""

import sys
from collections.abc import Iterator

from omegaconf import OmegaConf

from repro.cli.call import Call
from repro.cli.jobs import Job, resolve
from repro.networks.model import PAPER_ENCODER
from repro.parallel import has_gpu
from repro.system.places import conf_directory
from repro.world_config import WorldSpec, world_spec

SECONDS_PER_READING = 2e-6  # of the recorder on one core
LONG_RECORDING_MINUTES = 30


def print_notes(calls: list[Call], overrides: list[str]) -> None:
    """Print the scale where it was not chosen, warnings, and what trainings at paper scale cost without a GPU."""
    scale = calls[0].scale
    if calls[0].facts.names_scale and not any(override.startswith("scale=") for override in overrides):
        why = "a CUDA GPU is visible" if has_gpu() else "no CUDA GPU is visible"
        other = "laptop" if scale.name == "paper" else "paper"
        takes = OmegaConf.load(conf_directory() / "scale" / f"{other}.yaml").takes
        print(f"scale={scale.name} ({why}): {scale.size_px} px, the whole study takes {scale.takes}", flush=True)
        print(f"  the other default, scale={other}, takes {takes}; scale=smoke takes minutes", flush=True)
    for warning in dict.fromkeys(warning for call in calls for warning in warnings_of(call)):
        print(f"note: {warning}", file=sys.stderr)
    trainings = [call for call in calls if call.facts.trains and call.scale.name == "paper"]
    if trainings and not has_gpu():
        print_cost([resolve(call) for call in trainings])


def warnings_of(call: Call) -> Iterator[str]:
    """Yield warnings of values that are allowed and may surprise."""
    if call.runtime.precision in ("16-mixed", "16-true", "bf16-true"):
        yield f"runtime.precision={call.runtime.precision} has few digits: losses may not stay finite"
    encoder, weights = call.model.encoder_name, call.model.encoder_weights
    if encoder not in (None, PAPER_ENCODER):
        yield f"model.encoder_name={encoder} is not the paper's, which is {PAPER_ENCODER}"
    if weights is not None:
        yield f"model.encoder_weights={weights} are downloaded from the internet the first time"
    pairs = call.scale.pairs
    minutes = recording_seconds(world_spec(call.world, call.exp), pairs.train + pairs.val + pairs.test) / 60
    if call.task in ("all", "record") and minutes > LONG_RECORDING_MINUTES:
        yield f"recording exp {call.exp} takes about {minutes:.0f} min per core"
    if not call.experiment["clear_radius_m"]:
        yield f"exp {call.exp} has no clear zone: recording stops where an obstacle reaches the robot"
    if call.facts.trains and call.train.flip_augmentation:
        if call.experiment.get("fixed"):
            yield "train.flip_augmentation=true also shows the network the fixed obstacles upside down"
        if call.experiment["motion"]["name"] == "waypoints":
            yield "train.flip_augmentation=true also shows the network the robot's path upside down"


def recording_seconds(spec: WorldSpec, recordings: int) -> float:
    """Estimate the time to record an experiment on one core [s].

    Args:
        spec: what decides the worlds.
        recordings: number of recordings.
    """
    return recordings * spec.steps * spec.lidar.number * SECONDS_PER_READING


def print_cost(jobs: list[Job]) -> None:
    """Print the estimated duration of the trainings that are left, and how to ask for less."""
    from repro.learning.cost import training_seconds, trainings_at_once  # imports torch
    from repro.reporting.names import duration

    left = [job for job in jobs if not job.run.is_trained]
    if not left:
        return
    print("measuring what paper scale costs on this machine", flush=True)
    kinds = {_kind(job): job for job in left}
    runtime = left[0].call.runtime
    each = {kind: training_seconds(job.config, runtime.precision, runtime.accelerator) for kind, job in kinds.items()}
    at_once = min(len(left), trainings_at_once(left[0].config, runtime.accelerator))
    total = sum(each[_kind(job)] for job in left) / at_once
    trainings = "this training takes" if len(left) == 1 else f"these {len(left)} trainings take"
    print(
        f"warning: no CUDA GPU is visible: {trainings} about {duration(total)}. For less, use scale=laptop.",
        file=sys.stderr,
        flush=True,
    )


def _kind(job: Job) -> str:
    """Return what the duration of a training depends on, as text: everything but its worlds and its seed."""
    return str((job.config.model, job.config.encoding, job.config.train, job.call.scale))
