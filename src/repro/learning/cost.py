"""Cost of trainings on this machine, measured before they start."""

import time
from contextlib import nullcontext
from functools import partial

import torch

from repro.learning.kernels import accelerate, create_optimizer
from repro.learning.losses import MapLoss
from repro.maps.encodings import Encoding
from repro.networks.create import check_interface, create_network
from repro.networks.model import Model
from repro.recordings.datasets import encoding_of
from repro.runs.config import RunConfig
from repro.system.devices import clock, one_thread, resolve_device, resolve_precision

MIXED = {"bf16-mixed": torch.bfloat16, "16-mixed": torch.float16}  # the others are measured in float32
USUAL_EPOCHS = 20  # early stopping usually ends a training by then


def seconds_per_image(
    model: Model,
    encoding: Encoding,
    size_px: int,
    batch_size: int,
    precision: str,
    steps: int = 2,
    accelerator: str = "auto",
) -> float:
    """Measure forward pass, backward pass and optimizer step per image on this machine [s], after a warm-up step.

    On a CPU, it is the time of one thread, which the caller chooses, see `devices.one_thread`.

    Args:
        model: the network.
        encoding: its input.
        size_px: pixels along one side.
        batch_size: images per step.
        precision: precision of the trainer, such as 32-true or bf16-mixed.
        steps: measured steps.
        accelerator: auto, cpu or gpu.

    Raises:
        ValueError: the network cannot be saved, or does not map images to logits of one map.
    """
    device = resolve_device(accelerator)
    network = create_network(model, encoding.channels, encoding.frames)
    check_interface(network, encoding.channels, size_px)
    network.to(device)
    accelerate(network, device)
    optimizer, loss = create_optimizer(network, learning_rate=1e-3), MapLoss()
    image = torch.rand(batch_size, encoding.channels, size_px, size_px, device=device)
    image = image.to(memory_format=torch.channels_last)
    now = time.process_time if device == "cpu" else partial(clock, device)  # other processes share a CPU
    for step in range(steps + 1):
        if step == 1:  # the first step is a warm-up
            began = now()
        with torch.autocast(device, MIXED.get(precision), enabled=precision in MIXED):
            value = loss(network(image), image[:, :1])
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
    return (now() - began) / steps / batch_size


def training_seconds(config: RunConfig, precision: str, accelerator: str = "auto") -> float:
    """Estimate the duration of a training on this machine from a few steps [s], on a CPU on one thread.

    It is that of the maximum number of epochs, or of `USUAL_EPOCHS`.
    """
    assert config.train, "a baseline is not trained"
    device, size_px, batch_size, steps = resolve_device(accelerator), config.data.size_px, config.train.batch_size, 8
    if device == "cpu" and size_px > 64:  # a smaller batch suffices
        batch_size, steps = min(batch_size, 4), 2
    precision = resolve_precision(precision, device)
    with one_thread() if device == "cpu" else nullcontext():
        seconds = seconds_per_image(
            config.model, encoding_of(config), size_px, batch_size, precision, steps, accelerator
        )
    return seconds * config.data.pairs.train * min(config.train.max_epochs, USUAL_EPOCHS)
