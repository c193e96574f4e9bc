"""Cost of a study on this machine, measured before it starts."""

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace

import torch

from repro.config import Model, Training, paper_model
from repro.learning.kernels import accelerate
from repro.learning.losses import MapLoss
from repro.maps.datasets import encoding_of
from repro.networks.create import create_network
from repro.runs.config import RunConfig
from repro.system.devices import clock, one_thread, resolve_device, resolve_precision
from repro.system.resources import parallel_trainings

USUAL_EPOCHS = 20  # early stopping usually ends a training by then
EVALUATION_SECONDS = {64: 2.0, 128: 8.0, 256: 30.0}  # per run and 500 test pairs, by resolution [px]
ANALYSIS_SECONDS = 3.0  # per evaluated run


def seconds_per_image(
    model: Model, size_px: int, batch_size: int, precision: str, steps: int = 2, channels: int = 1, frames: int = 1
) -> float:
    """Measure forward pass, backward pass and optimizer step per image on this machine [s]."""
    device = resolve_device()
    network = create_network(model, channels, frames).to(device)
    accelerate(network, device)
    optimizer, loss = torch.optim.Adam(network.parameters()), MapLoss()
    image = torch.rand(batch_size, channels, size_px, size_px, device=device)
    for step in range(steps + 1):
        if step == 1:  # the first step is a warm-up
            began = clock(device)
        with torch.autocast(device, torch.bfloat16, enabled=precision.startswith("bf16")):
            logits = network(image)
        optimizer.zero_grad()
        loss(logits, image[:, :1]).backward()
        optimizer.step()
    return (clock(device) - began) / steps / batch_size


def plan_study(
    config: RunConfig,
    precision: str,
    recordings: int,
    recording_seconds: float,
    trainings: Mapping[str, int],
    evaluations: int,
) -> Iterator[str]:
    """Yield the remaining work of the study and its estimated duration, line by line as it is measured.

    Args:
        config: a run of the study.
        precision: see `devices.resolve_precision`.
        recordings: number of remaining recordings.
        recording_seconds: time to record them [s].
        trainings: number of remaining trainings of each of the paper's networks.
        evaluations: number of remaining runs to evaluate.
    """
    total, at_once = recording_seconds, trainings_at_once(config)
    yield f"  {recordings} recordings: {readable(total)}" if recordings else "  recordings: done"
    for name, count in trainings.items():
        if count:
            seconds = count * training_seconds(replace(config, model=paper_model(name)), precision)
            total += seconds / at_once
            yield f"  {count} x {name}: {readable(seconds)}"
        else:
            yield f"  {name}: done"
    if at_once > 1 and any(trainings.values()):
        yield f"  {at_once} trainings run at the same time, one per core"
    if evaluations:
        per_run = EVALUATION_SECONDS[min(EVALUATION_SECONDS, key=lambda px: abs(px - config.data.size_px))]
        seconds = evaluations * (per_run * config.data.pairs.test / 500 + ANALYSIS_SECONDS)
        total += seconds
        yield f"  evaluation and analysis of {evaluations} runs: {readable(seconds)}"
    if total:
        yield f"About {readable(total)} in total, at {_epochs(config)} epochs per training. It can be interrupted:"
        yield "the same command resumes."


def training_seconds(config: RunConfig, precision: str) -> float:
    """Estimate the duration of a training on this machine from a few steps [s], on a CPU on one thread."""
    device, size_px, encoding = resolve_device(), config.data.size_px, encoding_of(config)
    quick = device == "cuda" or size_px <= 64  # a smaller batch suffices on a CPU at high resolution
    batch_size, steps = (_training(config).batch_size, 8) if quick else (min(_training(config).batch_size, 4), 2)
    precision = resolve_precision(precision, device)
    with one_thread() if device == "cpu" else nullcontext():
        seconds = seconds_per_image(
            config.model, size_px, batch_size, precision, steps, encoding.channels, encoding.frames
        )
    return seconds * config.data.pairs.train * _epochs(config)


def trainings_at_once(config: RunConfig) -> int:
    """Return how many trainings like this one a sweep runs at the same time with the default launcher."""
    if resolve_device() == "cuda":
        return 1
    channels = encoding_of(config).channels
    return parallel_trainings(config.data.size_px, _training(config).batch_size, config.data.pairs.train, channels)


def readable(seconds: float) -> str:
    """Format a duration in seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.0f} h"


def _epochs(config: RunConfig) -> int:
    return min(_training(config).max_epochs, USUAL_EPOCHS)


def _training(config: RunConfig) -> Training:
    assert config.train, "a baseline is not trained"
    return config.train
