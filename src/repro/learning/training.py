"""Training of one network in its run directory: `config.yaml` in; weights, history and provenance out.

The data stays in memory as uint8 images, on the GPU if there is one, and is gathered and cast per batch. The order of
the samples, dropout and all other randomness of an epoch depend only on the seed and the number of the epoch, and a
checkpoint is written at the end of every epoch. Interrupted runs therefore resume bit-identically.

Paper: "Prediction Models": Adam, 1e-4, early stopping with threshold 0.001 and patience 5.
"""

import gc
import logging
import shutil
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import WeightAveraging
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from repro.learning.callbacks import Budget, Checkpoint, History, Stop
from repro.learning.checkpoints import WholeCheckpointIO, find_best, resume_from, start_from
from repro.learning.kernels import accelerate, create_optimizer
from repro.learning.losses import MapLoss, ShownLoss
from repro.learning.networks.convgru import is_centered
from repro.learning.networks.create import check_interface, create_network
from repro.learning.networks.trained import TorchNetwork, save_trained
from repro.maps.statistics import Statistics
from repro.networks.predictor import Predictor
from repro.recordings.datasets import Batches, Pairs, encoding_of, grid_of, load_pairs_of_run, training_statistics
from repro.recordings.reader import Recordings, open_recordings
from repro.runs.config import RunConfig, Training
from repro.runs.devices import forget_peak_memory, peak_memory_gb, resolve_device, resolve_precision
from repro.runs.directories import Run
from repro.runs.provenance import Status
from repro.system.errors import InputError
from repro.system.memory import keep_freed_memory
from repro.worlds.spec import WorldSpec


class TrainingModule(L.LightningModule):
    """A network with its data, loss and optimizer."""

    def __init__(
        self, network: nn.Module, train: Pairs, val: Pairs, settings: Training, seed: int, loss: nn.Module
    ) -> None:
        super().__init__()
        self.network = network
        self.loss = loss
        self.pairs: dict[str, Pairs] = {"train": train, "val": val}
        self.settings = settings
        self.seed = seed
        self.step_losses: list[Tensor] = []

    def train_dataloader(self) -> Batches:
        settings = self.settings
        return Batches(
            self.pairs["train"], settings.batch_size, self._epoch_seed(), flip_augmentation=settings.flip_augmentation
        )

    def val_dataloader(self) -> Batches:
        return Batches(self.pairs["val"], self.settings.batch_size)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return create_optimizer(self, self.settings.learning_rate)

    def on_train_epoch_start(self) -> None:
        torch.manual_seed(self._epoch_seed())
        self.step_losses.clear()

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        loss = self._batch_loss(batch)
        self.step_losses.append(loss.detach())
        return loss

    def validation_step(self, batch: tuple[Tensor, Tensor], _: int) -> None:
        self.log("val_loss", self._batch_loss(batch), batch_size=len(batch[0]))

    def train_loss(self) -> Tensor:
        """Compute the mean loss over the steps of the epoch; read once per epoch, so that a GPU never waits for it.

        Raises:
            FloatingPointError: a loss is not finite.
        """
        losses = torch.stack(self.step_losses)
        not_finite = (~torch.isfinite(losses)).nonzero()
        if len(not_finite):
            batch = int(not_finite[0, 0])
            raise FloatingPointError(f"the loss is {losses[batch]} at epoch {self.current_epoch}, batch {batch}")
        return losses.mean()

    def _batch_loss(self, batch: tuple[Tensor, Tensor]) -> Tensor:
        image, target = batch
        return self.loss(self.network(image.to(memory_format=torch.channels_last)), target)

    def _epoch_seed(self) -> int:
        return self.seed * 1_000_003 + self.current_epoch


def train(
    run: Run, recordings: Path, *, accelerator: str = "auto", precision: str = "auto", budget: Budget | None = None
) -> Status:
    """Train the network of a run directory, or resume its training.

    Args:
        run: a run directory with its config.yaml (`Run.prepare`).
        recordings: the recorded experiment to train on.
        accelerator: auto, cpu, gpu, see `devices.resolve_device`.
        precision: precision in Lightning's terms, 32-true or bf16-mixed; auto is bf16-mixed on devices with native
            support and 32-true elsewhere.
        budget: time limit; when it is reached, the run pauses at the end of the epoch. None is no limit.

    Returns:
        `trained` (`evaluated` if the run already is) or `paused`.

    Raises:
        InputError: the recordings are missing, damaged or differ from those the run started with, or the network does
            not map images to logits of one map.
        FloatingPointError: the loss is not finite; the run is marked failed.
    """
    with run.exclusive():
        if run.is_trained:
            return run.status
        if budget and budget.is_spent():
            return Status.paused
        config = run.config()
        gc.collect()  # the data of the training before: its trainer and its module refer to each other
        forget_peak_memory()
        opened = open_recordings(recordings)
        opened.check_worlds(config.data.worlds)
        run.use_recordings(opened.hash(asdict(config.data.pairs)))
        statistics = training_statistics(opened, config)  # refuses worlds without hits before the training
        device = resolve_device(accelerator)
        precision = resolve_precision(precision, device)
        module = _training_module(opened, config, device)
        run.begin_step("trained", Status.training, precision=precision, command=run.command)
        try:
            paused, facts = fit(module, run.path, device, precision, budget)
        except FloatingPointError as error:
            run.end_step(Status.failed, str(error))
            raise
        if paused:
            run.end_step(Status.paused, **facts)
            return run.status
        load_best(module, run.path)
        checksum = save_trained(_predictor(module.network, opened.spec, config, statistics), run.model)
        run.end_step(Status.trained, **facts, weights_sha256=checksum)
        shutil.rmtree(run.path / "checkpoints", ignore_errors=True)
        return run.status


def _predictor(network: nn.Module, spec: WorldSpec, config: RunConfig, statistics: Statistics) -> Predictor:
    """Return a trained network with what a prediction needs."""
    window = (spec.steps, spec.world.step_time, bool(spec.fixed), is_centered(network))
    return Predictor(TorchNetwork(network), encoding_of(config), grid_of(config), statistics, *window)


def _training_module(recordings: Recordings, config: RunConfig, device: str) -> TrainingModule:
    """Create the network of a run's configuration and load the data."""
    assert config.train is not None, "a baseline is not trained"
    assert config.seed is not None, "a baseline is not trained"
    torch.manual_seed(config.seed)
    encoding = encoding_of(config)
    network = create_network(config.model, encoding.channels, encoding.frames)
    check_interface(network, encoding.channels, config.data.size_px)
    if config.train.weights is not None:  # before the data are drawn, which takes minutes
        start_from(network, config.train.weights)
    shown = config.train.loss == "shown"
    train_pairs, val_pairs = (
        load_pairs_of_run(recordings, split, config, device, marks_hidden=shown) for split in ("train", "val")
    )
    accelerate(network, device)
    keep_freed_memory()  # for the training steps; the data is loaded before
    loss = MapLoss(config.train.dice_eps) if config.train.loss == "map" else ShownLoss()  # nothing is marked: Eq. 1
    return TrainingModule(network, train_pairs, val_pairs, config.train, config.seed, loss)


def fit(
    module: TrainingModule, directory: Path, device: str, precision: str, budget: Budget | None = None
) -> tuple[bool, dict[str, Any]]:
    """Train until early stopping, the last epoch or the time limit; return whether the limit came first, and facts
    for the provenance.

    The directory gets history.csv and checkpoints, from which the training resumes if it has some.
    """
    settings = module.settings
    checkpoints = directory / "checkpoints"
    history = History(directory / "history.csv")
    stop = Stop(budget, min_delta=settings.min_delta, patience=settings.patience)
    callbacks: list[L.Callback] = [history, stop, Checkpoint(checkpoints, "best", monitor="val_loss")]
    callbacks.append(Checkpoint(checkpoints, "last"))
    if settings.ema_decay:  # the average is validated and saved
        callbacks.append(WeightAveraging(multi_avg_fn=get_ema_multi_avg_fn(settings.ema_decay)))
    quiet()
    trainer = L.Trainer(
        max_epochs=settings.max_epochs,
        accelerator="gpu" if device == "cuda" else "cpu",
        devices=1,
        precision=precision,  # type: ignore[arg-type]
        callbacks=callbacks,
        plugins=[WholeCheckpointIO()],
        logger=False,
        reload_dataloaders_every_n_epochs=1,
        num_sanity_val_steps=0,
        enable_progress_bar=False,  # that of `History` is also a line in logs
        enable_model_summary=False,
    )
    try:
        trainer.fit(module, ckpt_path=resume_from(checkpoints), weights_only=True)
    except SystemExit:  # Lightning raises it on Ctrl-C
        raise KeyboardInterrupt from None
    return stop.paused, {
        "train_pairs": len(module.pairs["train"]),
        "epochs": len(history.rows),
        "training_seconds": round(sum(row["seconds"] for row in history.rows), 1),
        "peak_memory_gb": round(peak_memory_gb(), 2),
    }


def load_best(module: TrainingModule, directory: Path) -> None:
    """Load the best weights of a training in a directory.

    Raises:
        InputError: they are damaged.
    """
    checkpoints = directory / "checkpoints"
    best = find_best(checkpoints)
    if best is None:
        shutil.rmtree(checkpoints, ignore_errors=True)
        raise InputError(f"the best weights in {checkpoints} are damaged: run the same command again to retrain")
    module.load_state_dict(torch.load(best, map_location="cpu", weights_only=True)["state_dict"])


def quiet() -> None:
    """Silence Lightning's warnings of loaders and workers, and those of libraries about their next versions."""
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module="lightning")
    warnings.filterwarnings("ignore", category=FutureWarning)
