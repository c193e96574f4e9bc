"""What a study costs on this machine, measured before it starts."""

from collections.abc import Iterator

import torch

from repro.config import Scale
from repro.devices import clock, resolve_device, resolve_precision
from repro.learning.kernels import accelerate
from repro.learning.losses import MapLoss
from repro.learning.models import create_model

USUAL_EPOCHS = 20  # at which early stopping has usually ended a training
_RECORDING_SECONDS = 0.008  # a recording on one core


def seconds_per_image(architecture: str, size_px: int, batch_size: int, precision: str, steps: int = 2) -> float:
    """Measures forward, backward and step for one image on this machine [s]."""
    device = resolve_device()
    model = create_model(architecture).to(device)
    accelerate(model, device)
    optimizer, loss = torch.optim.Adam(model.parameters()), MapLoss()
    image = torch.rand(batch_size, 1, size_px, size_px, device=device)
    for step in range(steps + 1):
        if step == 1:  # the one before was warm-up
            began = clock(device)
        with torch.autocast(device, torch.bfloat16, enabled=precision.startswith("bf16")):
            logits = model(image)
        optimizer.zero_grad()
        loss(logits, image).backward()
        optimizer.step()
    return (clock(device) - began) / steps / batch_size


def plan_study(scale: Scale, precision: str, recordings: int, trainings: dict[str, int]) -> Iterator[str]:
    """Says what is left of `make reproduce` at a scale and about how long it will take, line by line as it is measured.

    Args:
        scale: the scale.
        precision: see `devices.resolve_precision`.
        recordings: how many are left to record.
        trainings: how many are left to train, of each network.
    """
    yield (
        f"Scale {scale.name} ({_reason()}): {scale.size_px} px, {scale.pairs.train} training pairs an experiment, "
        f"at most {scale.max_epochs} epochs."
    )
    total = recordings * _RECORDING_SECONDS / 2
    yield f"  {recordings} recordings: {_readable(total)}" if recordings else "  recordings: done"
    for name, count in trainings.items():
        if count:
            seconds = count * _training_seconds(name, scale, precision)
            total += seconds
            yield f"  {count} x {name}: {_readable(seconds)}"
        else:
            yield f"  {name}: done"
    yield f"About {_readable(total)} in all, at {_epochs(scale)} epochs a training. Stop it whenever you like:"
    yield "the same command goes on where it was."


def cost_warning(networks: list[str], scale: Scale, precision: str) -> str | None:
    """Says what some trainings cost without a GPU and how to ask for less; None where there is a GPU."""
    if torch.cuda.is_available():
        return None
    seconds = {name: _training_seconds(name, scale, precision) for name in sorted(set(networks))}
    total = sum(seconds[name] for name in networks)
    what = "this training takes" if len(networks) == 1 else f"these {len(networks)} trainings take"
    return (
        f"warning: no CUDA GPU is visible: {what} about {_readable(total)} at {_epochs(scale)} epochs of "
        f"{scale.pairs.train} pairs of {scale.size_px} px. For less, add scale=laptop (or scale=smoke)."
    )


def _reason() -> str:
    return f"the GPU {torch.cuda.get_device_name()}" if torch.cuda.is_available() else "no CUDA GPU is visible"


def _training_seconds(architecture: str, scale: Scale, precision: str) -> float:
    device = resolve_device()
    quick = device == "cuda" or scale.size_px <= 64  # else a smaller batch tells a CPU's speed soon enough
    batch_size, steps = (scale.batch_size, 8) if quick else (4, 2)
    precision = resolve_precision(precision, device)
    each = seconds_per_image(architecture, scale.size_px, batch_size, precision, steps)
    return each * scale.pairs.train * _epochs(scale)


def _epochs(scale: Scale) -> int:
    return min(scale.max_epochs, USUAL_EPOCHS)


def _readable(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.0f} h"
