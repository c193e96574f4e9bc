"""Adaptation of a network to logs of a wide lidar, whose beams outside of the view of the network label its maps.

The last fifth of each log is for validation, or a part of little more than a window if that is longer. The weights are
those of the epoch with the least validation loss.
"""

import functools
import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from repro.config import Training
from repro.learning.held_out import View, labeled, turns_of
from repro.learning.kernels import accelerate
from repro.learning.losses import bce_loss
from repro.learning.training import TrainingModule, fit, load_best
from repro.maps.bits import pack_bits
from repro.maps.statistics import Statistics, summarize
from repro.networks.predictor import Predictor
from repro.prediction.agreement import Observed
from repro.prediction.logs import ScanLog
from repro.prediction.times import WindowSettings
from repro.recordings.datasets import Pairs
from repro.scans import Scans
from repro.system.errors import InputError

UNKNOWN = 2  # in a map, where 1 is free and 0 an obstacle
MAX_WINDOWS = 150  # of a log through one view, so that long logs do not outweigh the others
VALIDATION_SHARE, VALIDATION_WINDOWS = 0.2, 1.2  # of each log, at its end, but no less than so many windows
SCHEDULE = Training(  # ours
    learning_rate=1e-3,
    min_delta=0.0,
    patience=2,
    batch_size=8,
    max_epochs=2,
    dice_eps=1e-6,
    flip_augmentation=True,
    ema_decay=0.99,
)


@dataclass(frozen=True)
class Labeled:
    """Windows of logs with partial labels.

    Args:
        pairs: encoded scans, and maps of which 1 is free, 0 an obstacle and 2 unknown.
        statistics: those of the windows.
    """

    pairs: Pairs
    statistics: Statistics


class PartialLoss(nn.Module):
    """Binary cross-entropy (Eq. 1) on the pixels whose label is known."""

    def forward(self, logits: Tensor, target: Tensor) -> Tensor:
        """Compute the loss of logits (B, 1, H, W) against labels (B, 1, H, W), of which 2 is unknown, in float32."""
        known = (target != UNKNOWN).float()
        return bce_loss(logits.float(), target.clamp(max=1).float(), known)


def label(
    log: ScanLog, settings: WindowSettings, predictor: Predictor, view: View, *, seed: int
) -> tuple[Labeled, Labeled]:
    """Return the labeled windows of a log for training, through views in several directions, and those for validation.

    The frame of the log is turned at random for each view: buildings have walls in all directions.

    Args:
        log: the log of a wide lidar.
        settings: steps of the windows.
        predictor: the network that will be adapted.
        view: field of view, and range of the labels.
        seed: seed of the turns.

    Raises:
        InputError: the lidar does not see beyond the view, or the log is too short for both.
    """
    rng = np.random.default_rng(seed)
    views = [replace(view, turn_rad=turn) for turn in turns_of(log, view.fov_rad)]
    last_s = max(VALIDATION_SHARE * (log.stamps[-1] - log.stamps[0]), VALIDATION_WINDOWS * settings.duration_s)
    is_first = log.stamps <= log.stamps[-1] - last_s
    limited = predictor.with_range(log.range_max_m)
    first = _windows(_part(log, is_first), settings, limited, views, rng)
    last = _windows(_part(log, ~is_first), settings, limited, [views[len(views) // 2]], rng)
    if not (first and last):
        raise InputError("no window of the first or of the last part of the log has hits and passes beside the view")
    return _drawn(first, limited), _drawn(last, limited)


def _part(log: ScanLog, kept: np.ndarray) -> ScanLog:
    """Return some scans of a log, given which, (S,)."""
    return replace(log, stamps=log.stamps[kept], ranges=log.ranges[kept], poses=log.poses[kept])


def _rotated(log: ScanLog, rng: np.random.Generator) -> ScanLog:
    """Return the log in a frame that is turned at random."""
    angle = rng.uniform(0, 2 * math.pi)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return replace(log, poses=np.column_stack([log.poses[:, :2] @ turn.T, log.poses[:, 2] + angle]))


def _windows(
    log: ScanLog, settings: WindowSettings, predictor: Predictor, views: list[View], rng: np.random.Generator
) -> list[tuple[Scans, Observed]]:
    """Return windows of a log through each view, evenly over the log, with hits and passes beside the view."""
    steps = (log.stamps[-1] - log.stamps[0] - settings.duration_s) / settings.step_s
    stride = max(1.0, steps / MAX_WINDOWS)
    return [
        (window.scans, shown)
        for view in views
        for window, shown in labeled(_rotated(log, rng), settings, stride, predictor.grid, view)
        if shown.hits.any() and shown.passed.any()
    ]


def _drawn(windows: list[tuple[Scans, Observed]], predictor: Predictor) -> Labeled:
    encoding, grid = predictor.encoding, predictor.grid
    images, maps = [], []
    for scans, shown in windows:
        image = encoding.encode(scans.tensors(), grid)
        images.append(pack_bits(image) if encoding.is_binary else image)
        values = np.where(shown.hits, 0, np.where(shown.passed, 1, UNKNOWN)).astype(np.uint8)
        maps.append(torch.from_numpy(values)[None, None])
    statistics = summarize((scans.tensors() for scans, _ in windows), grid)
    return Labeled(Pairs(torch.cat(images), torch.cat(maps), encoding), statistics)


def adapt(
    predictor: Predictor,
    logs: list[tuple[Labeled, Labeled]],
    *,
    seed: int = 0,
    device: str = "cpu",
    precision: str = "32-true",
) -> tuple[Predictor, float, float]:
    """Train a network on labeled windows of logs.

    Args:
        predictor: the network; it is not changed.
        logs: the windows of each log for training and validation, see `label`.
        seed: seed of the order.
        device: cpu or cuda.
        precision: 32-true or bf16-mixed.

    Returns:
        the adapted network, with the statistics of both trainings, and the validation loss before and after.

    Raises:
        InputError: the network cannot be trained, or the validation loss does not fall.
    """
    train, val = (_joined(part, device) for part in zip(*logs, strict=True))
    network = predictor.copied_network().to(device)
    accelerate(network, device)
    module = TrainingModule(network, train, val, SCHEDULE, seed, PartialLoss())
    before = _validation_loss(module)
    with tempfile.TemporaryDirectory(prefix="adaptation-") as directory:
        fit(module, Path(directory), device, precision)
        load_best(module, Path(directory))
    module.to(device)
    after = _validation_loss(module)
    if not after < before:
        raise InputError(f"the validation loss does not fall on these logs: {before:.4f} before, {after:.4f} adapted")
    known = [predictor.statistics] if predictor.statistics else []
    statistics = functools.reduce(Statistics.widened, [*known, *(first.statistics for first, _ in logs)])
    return replace(predictor, network=network.cpu(), statistics=statistics), before, after


def _joined(parts: tuple[Labeled, ...], device: str) -> Pairs:
    """Return the pairs of several logs on a device."""
    pairs = [part.pairs for part in parts]
    stored, maps = torch.cat([each.stored for each in pairs]), torch.cat([each.maps for each in pairs])
    return Pairs(stored.to(device), maps.to(device), pairs[0].encoding)


@torch.inference_mode()
def _validation_loss(module: TrainingModule) -> float:
    module.network.eval()
    losses = [module.loss(module.network(image), target) for image, target in module.val_dataloader()]
    return float(torch.stack(losses).mean())
