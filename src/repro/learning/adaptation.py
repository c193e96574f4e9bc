"""Adaptation of a network to logs of a wide lidar, whose beams outside of the view of the network label its maps.

Beams show the near side of what they hit, so a network that learned from logs alone would forget the far side of
people, and where they may have gone. It therefore rehearses in simulated worlds, whose maps are known as a whole.

The last fifth of each log is for validation, or a part of little more than a window if that is longer. Of each round,
the weights of the epoch with the least validation loss are kept and calibrated.
"""

import copy
import functools
import math
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.lr_scheduler import OneCycleLR

from repro.learning.held_out import View, labeled, stands, turns_of
from repro.learning.kernels import accelerate
from repro.learning.labels import MOVER, UNKNOWN, Labeled, drawn
from repro.learning.losses import bce_loss, shown_weight
from repro.learning.networks.convgru import ConvGRU, is_centered
from repro.learning.networks.trained import TorchNetwork, module_of
from repro.learning.platt import calibrate
from repro.learning.training import TrainingModule, fit, load_best
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.statistics import Statistics
from repro.networks.predictor import Predictor
from repro.prediction.agreement import Observed
from repro.recordings.datasets import HIDDEN, Pairs
from repro.runs.config import Training
from repro.scans import Scans
from repro.system.errors import InputError

DRAWS, STANDING_DRAWS = 12, 3  # directions of the view of each log; a view that swings is in all of them in turn
MAX_WINDOWS = 60  # of each view, so that no log outweighs others; they are drawn from up to twice as many
VALIDATION_SHARE, VALIDATION_WINDOWS = 0.2, 1.2  # of each log, at its end, but no less than so many windows
EPOCHS = 2, 1  # of each round, in which the learning rate rises and falls; the second has more simulated windows
TRAINED_WINDOWS = 10_000  # of logs in all epochs at least: short logs are repeated, the best epoch is kept
MOVER_WEIGHT = 5.0
WARM_UP = 0.1  # of the training, in which the learning rate rises before it falls to zero
SCHEDULE = Training(  # ours
    learning_rate=1e-3, min_delta=0.0, patience=1000, batch_size=4, max_epochs=1, dice_eps=1e-6, flip_augmentation=True
)


class PartialLoss(nn.Module):
    """Binary cross-entropy (Eq. 1) where the label is known, averaged over the windows.

    What standing obstacles hide counts a tenth, as in `losses.ShownLoss`, and where something that moves can be, five
    times as much, since few pixels teach how people look and where they go.
    """

    def forward(self, logits: Tensor, target: Tensor) -> Tensor:
        """Compute the loss of logits (B, 1, H, W) against the maps of `Labeled`, (B, 1, H, W), in float32."""
        codes = target.to(torch.uint8)
        weights = ((codes & UNKNOWN) == 0) * shown_weight((codes & HIDDEN) > 0)
        weights = weights * (1 + (MOVER_WEIGHT - 1) * ((codes & MOVER) > 0))
        windows = zip(logits.float(), (codes & 1).float(), weights, strict=True)
        return torch.stack([bce_loss(*window) for window in windows]).mean()


class AdaptationModule(TrainingModule):
    """Training on random squares of the maps, which takes half the time, with a learning rate that falls to zero."""

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        size = batch[1].shape[-1]
        side = 3 * size // 16 * 4
        row, column = torch.randint(size - side + 1, (2,)).tolist()
        image, target = (array[..., row : row + side, column : column + side] for array in batch)
        middle = [(size / 2 - row, size / 2 - column)] if is_centered(self.network) else []
        loss: Tensor = self.loss(self.network(image.to(memory_format=torch.channels_last), *middle), target)
        self.step_losses.append(loss.detach())
        return loss

    def configure_optimizers(self) -> Any:
        optimizer = super().configure_optimizers()
        steps = int(self.trainer.estimated_stepping_batches)
        schedule = OneCycleLR(optimizer, self.settings.learning_rate, total_steps=steps, pct_start=WARM_UP)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def label(
    log: ScanLog, settings: WindowSettings, predictor: Predictor, view: View, *, seed: int
) -> tuple[Labeled, Labeled]:
    """Return the labeled windows of a log for training, through views in random directions, and those for validation.

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
    if not predictor.has_fixed:
        settings = replace(settings, center="robot")
    rng = np.random.default_rng(seed)
    turns = turns_of(log, view.fov_rad)
    extent, draws = ((0.0, 2 * math.pi), STANDING_DRAWS) if stands(log) else ((turns[0], turns[-1]), DRAWS)
    views = [replace(view, turn_rad=float(turn)) for turn in rng.uniform(*extent, draws)]
    middle = replace(view, turn_rad=turns[len(turns) // 2])
    last_s = max(VALIDATION_SHARE * (log.stamps[-1] - log.stamps[0]), VALIDATION_WINDOWS * settings.duration_s)
    is_first = log.stamps <= log.stamps[-1] - last_s
    limited = predictor.with_range(log.range_max_m)
    first = _windows(_part(log, is_first), settings, limited, views, rng)
    last = _windows(_part(log, ~is_first), settings, limited, [middle], rng)
    if not (first and last):
        raise InputError("no window of the first or of the last part of the log has hits and passes beside the view")
    return _labeled(first, limited), _labeled(last, limited)


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
    """Return windows of a log through each view, with hits and passes beside the view.

    Windows whose maps have more labels are drawn more often, since the loss is a mean over the labels of a window: so
    all labels of a log count alike. The windows are drawn evenly over the log in this measure.
    """
    steps = max((log.stamps[-1] - log.stamps[0] - settings.duration_s) / settings.step_s, 0.0)
    stride = max(1.0, steps / (2 * MAX_WINDOWS))
    windows = []
    for view in views:
        first_s = log.stamps[0] + rng.uniform(0, min(stride, steps)) * settings.step_s  # others than of other views
        turned = _rotated(_part(log, log.stamps >= first_s), rng)
        labels = labeled(turned, settings, stride, predictor.grid, view)
        own = [(window.scans, shown) for window, shown in labels if shown.hits.any() and shown.passed.any()]
        count = min(len(own), MAX_WINDOWS)
        known = np.cumsum([shown.hits.sum() + shown.passed.sum() for _, shown in own])
        places = (np.arange(count) + rng.random()) / max(count, 1) * known[-1:]
        windows += [own[number] for number in np.searchsorted(known, places)]
    return windows


def _labeled(windows: list[tuple[Scans, Observed]], predictor: Predictor) -> Labeled:
    shown = (np.where(label.hits, 0, np.where(label.passed, 1, UNKNOWN)) for _, label in windows)
    return drawn([scans for scans, _ in windows], list(shown), predictor)


def adapt(
    predictor: Predictor,
    logs: list[tuple[Labeled, Labeled]],
    simulated: Iterable[Labeled | None] = repeat(None),
    *,
    seed: int = 0,
    device: str = "cpu",
    precision: str = "32-true",
) -> tuple[Predictor, float, float]:
    """Train a network on labeled windows of logs.

    Args:
        predictor: the network; it is not changed.
        logs: the windows of each log for training and validation, see `label`.
        simulated: windows in which the network rehearses in each round, see `rehearsal.rehearsed`; none by default.
        seed: seed of the order.
        device: cpu or cuda.
        precision: 32-true or bf16-mixed.

    Returns:
        the adapted network, with the statistics of both trainings, and the validation loss before and after.

    Raises:
        InputError: the network cannot be trained, or the validation loss does not fall.
    """
    first, last = (list(part) for part in zip(*logs, strict=True))
    val = _joined(last, device)
    network = copy.deepcopy(module_of(predictor))
    if isinstance(network, ConvGRU) and not (network.centered or predictor.has_fixed):
        network = network.with_distances()
    network.to(device)
    accelerate(network, device)
    times = max(1, round(TRAINED_WINDOWS / (sum(EPOCHS) * sum(len(labeled.pairs) for labeled in first))))
    losses = []
    for number, (epochs, own) in enumerate(zip(EPOCHS, simulated, strict=False)):
        train = _joined([*first, own] if own else first, device)
        settings = replace(SCHEDULE, max_epochs=times * epochs)
        module = AdaptationModule(network, train, val, settings, seed + number, PartialLoss())
        losses.append(_validation_loss(module))
        _train(module, val, device, precision)
    before, after = losses[0], _validation_loss(module)
    if not after < before:
        raise InputError(f"the validation loss does not fall on these logs: {before:.4f} before, {after:.4f} adapted")
    known = [predictor.statistics] if predictor.statistics else []
    statistics = functools.reduce(Statistics.widened, [*known, *(labeled.statistics for labeled in first)])
    adapted = replace(predictor, network=TorchNetwork(network), statistics=statistics, is_centered=is_centered(network))
    return adapted, before, after


def _train(module: TrainingModule, val: Pairs, device: str, precision: str) -> None:
    """Train and calibrate a network."""
    with tempfile.TemporaryDirectory(prefix="adaptation-") as directory:
        fit(module, Path(directory), device, precision)
        load_best(module, Path(directory))
    module.to(device)
    calibrate(module.network, val)


def _joined(parts: list[Labeled], device: str) -> Pairs:
    """Return the pairs of several logs on a device."""
    pairs = [part.pairs for part in parts]
    stored, maps = torch.cat([part.stored for part in pairs]), torch.cat([part.maps for part in pairs])
    return Pairs(stored.to(device), maps.to(device), pairs[0].encoding)


@torch.inference_mode()
def _validation_loss(module: TrainingModule) -> float:
    module.network.eval()
    losses = [module.loss(module.network(image), target) for image, target in module.val_dataloader()]
    return float(torch.stack(losses).mean())
