"""What a study costs on this machine, measured before it starts."""

import torch

from repro.config import NETWORKS, Scale
from repro.devices import clock, resolve_device, resolve_precision
from repro.learning.losses import MapLoss
from repro.learning.models import create_model

TRAININGS = 6  # of each network: four experiments, and two without decay
USUAL_EPOCHS = 20  # at which early stopping has usually ended a training
_RECORDING_SECONDS = 0.008  # a recording on one core


def seconds_per_image(architecture: str, size_px: int, batch_size: int, precision: str, steps: int = 2) -> float:
    """Measures forward, backward and step for one image on this machine [s]."""
    device = resolve_device()
    model = create_model(architecture).to(device).to(memory_format=torch.channels_last)
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


def plan_study(scale: Scale, precision: str) -> str:
    """Says what `make reproduce` will do at a scale and about how long it will take."""
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    reason = f"the GPU {gpu}" if gpu else "no CUDA GPU is visible"
    seconds = {name: _training_seconds(name, scale, precision) for name in NETWORKS}
    recording = 4 * (scale.pairs.train + scale.pairs.val + scale.pairs.test) * _RECORDING_SECONDS / 2
    total = recording + TRAININGS * sum(seconds.values())
    lines = [
        f"Scale {scale.name} ({reason}): {scale.size_px} px, {scale.pairs.train} training pairs an "
        f"experiment, at most {scale.max_epochs} epochs.",
        f"About {_readable(total)} in all, at {_epochs(scale)} epochs a training: recording {_readable(recording)}",
        *(f"  {TRAININGS} x {name}: {_readable(TRAININGS * value)}" for name, value in seconds.items()),
        "Stop it at any time: the same command goes on where it was.",
    ]
    return "\n".join(lines)


def cost_warning(architecture: str, scale: Scale, precision: str) -> str | None:
    """Says what one training costs without a GPU and how to ask for less; None where there is a GPU."""
    if torch.cuda.is_available():
        return None
    seconds = _training_seconds(architecture, scale, precision)
    return (
        f"No CUDA GPU is visible: this training takes about {_readable(seconds)} at {_epochs(scale)} epochs of "
        f"{scale.pairs.train} pairs of {scale.size_px} px. For less, add scale=laptop (or scale=smoke)."
    )


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
