"""Trains one network in its run directory: `config.yaml` in; weights, history and provenance out.

The data lives in memory as uint8 images, on the GPU where there is one, and is gathered and cast per batch.
Order, dropout and everything else random of an epoch follow from the seed and the epoch's number alone, and a
checkpoint is written at every epoch's end, so that a run killed at any moment and started again ends with the
same numbers as one that never was.

Paper: "Prediction Models": Adam, 1e-4, early stopping with threshold 0.001 and patience 5.
"""

import logging
import shutil
import warnings
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.loggers import TensorBoardLogger
from segmentation_models_pytorch.base import SegmentationModel
from torch import Tensor

from repro.learning.callbacks import Budget, History, Stop
from repro.learning.losses import MapLoss
from repro.learning.models import compiles, create_model, resolve_device, resolve_precision
from repro.maps.datasets import Batches, Pairs, load_pairs_of_run
from repro.runs import lock, read_config, read_status, write_provenance
from repro.simulation.store import check_recordings


class Predictor(L.LightningModule):
    """A network with its loss and optimiser."""

    def __init__(self, model: SegmentationModel, train: Pairs, val: Pairs, config: dict[str, Any]) -> None:
        super().__init__()
        self.model, self.loss, self.config = model, MapLoss(config["dice_eps"]), config
        self.pairs: dict[str, Pairs] = {"train": train, "val": val}
        self.step_losses: list[Tensor] = []

    def train_dataloader(self) -> Batches:
        return Batches(self.pairs["train"], self.config["batch_size"], self._epoch_seed())

    def val_dataloader(self) -> Batches:
        return Batches(self.pairs["val"], self.config["batch_size"])

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.parameters(), lr=self.config["learning_rate"], fused=True)

    def on_train_epoch_start(self) -> None:
        torch.manual_seed(self._epoch_seed())
        self.step_losses.clear()

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        image, target = batch
        loss = self.loss(self.model(image.to(memory_format=torch.channels_last)), target)
        self.step_losses.append(loss.detach())
        return loss

    def validation_step(self, batch: tuple[Tensor, Tensor], _: int) -> None:
        image, target = batch
        loss = self.loss(self.model(image.to(memory_format=torch.channels_last)), target)
        self.log("val_loss", loss, batch_size=len(image))

    def train_loss(self) -> Tensor:
        """Mean loss of the epoch's steps; looked at once an epoch, so that a GPU never waits.

        Raises:
            FloatingPointError: a loss is not finite.
        """
        losses = torch.stack(self.step_losses)
        broken = (~torch.isfinite(losses)).nonzero()
        if len(broken):
            value, batch = losses[broken[0, 0]].item(), broken[0, 0].item()
            raise FloatingPointError(f"the loss is {value} at epoch {self.current_epoch}, batch {batch}")
        return losses.mean()

    def _epoch_seed(self) -> int:
        return self.config["seed"] * 1_000_003 + self.current_epoch


def train(
    run: Path,
    recordings: Path,
    *,
    accelerator: str = "auto",
    precision: str = "auto",
    compile: bool = False,
    max_minutes: float | None = None,
) -> str:
    """Trains the network of a run directory, from where it was left if it was.

    Args:
        run: a run directory with its config.yaml (`runs.prepare_run`).
        recordings: the recorded experiment to train on.
        accelerator: Lightning's: auto, cpu, gpu.
        precision: Lightning's: 32-true, bf16-mixed; auto is bf16-mixed where it is native, else 32-true.
        compile: whether to compile the network with torch.compile; where that fails it says so and goes on.
        max_minutes: budget of this process; reaching it pauses the run at an epoch's end, after one epoch at least.

    Returns:
        `finished` or `paused`.

    Raises:
        ValueError: the recordings are missing, broken or others than the run began with.
        FloatingPointError: the loss is not finite; the run is marked failed.
    """
    with lock(run):
        if read_status(run) in ("finished", "evaluated"):
            return "finished"
        if Budget.is_spent(max_minutes):
            return "paused"
        check_recordings(run, recordings)
        config = read_config(run)
        device = resolve_device(accelerator)
        precision = resolve_precision(precision, device)
        model, size_px = config["model"], config["data"]["size_px"]
        compile = compile and compiles(model["name"], model["encoder_name"], size_px, device)
        write_provenance(run, status="training", seed=config["seed"], precision=precision, compiled=compile)
        predictor = _predictor(recordings, config, device)
        if compile:
            predictor.model.compile()
        try:
            finished = _fit(run, predictor, device, precision, max_minutes)
        except FloatingPointError as error:
            write_provenance(run, status="failed", error=str(error))
            raise
        write_provenance(run, status="finished" if finished else "paused")
        if finished:
            shutil.rmtree(run / "checkpoints")
        return "finished" if finished else "paused"


def _predictor(recordings: Path, config: dict[str, Any], device: str) -> Predictor:
    """Loads the data and creates the network that a run's configuration names."""
    model = config["model"]
    train_pairs, val_pairs = (load_pairs_of_run(recordings, split, config, device) for split in ("train", "val"))
    torch.manual_seed(config["seed"])
    network = create_model(model["name"], encoder_name=model["encoder_name"], encoder_weights=model["encoder_weights"])
    settings = {**config["train"], "seed": config["seed"]}
    return Predictor(network.to(memory_format=torch.channels_last), train_pairs, val_pairs, settings)


def _fit(run: Path, predictor: Predictor, device: str, precision: str, max_minutes: float | None) -> bool:
    """Fits until early stopping, the last epoch or the budget; returns whether that was the end."""
    settings, checkpoints = predictor.config, run / "checkpoints"
    history = History(run / "history.csv")
    stop = Stop(max_minutes, min_delta=settings["min_delta"], patience=settings["patience"])
    best = _checkpoint(checkpoints, "best", monitor="val_loss", save_weights_only=True)
    last = _checkpoint(checkpoints, "last")
    quiet()
    trainer = L.Trainer(
        max_epochs=settings["max_epochs"],
        accelerator="gpu" if device == "cuda" else "cpu",
        devices=1,
        precision=precision,  # type: ignore[arg-type]
        callbacks=[history, stop, best, last],
        logger=TensorBoardLogger(run, name="tensorboard", version=""),
        log_every_n_steps=10**9,  # the epochs' losses only
        reload_dataloaders_every_n_epochs=1,
        num_sanity_val_steps=0,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    resume = checkpoints / "last.ckpt"
    trainer.fit(predictor, ckpt_path=resume if resume.is_file() else None, weights_only=False)
    if stop.paused:
        return False
    state = torch.load(checkpoints / "best.ckpt", map_location="cpu", weights_only=False)["state_dict"]
    predictor.load_state_dict(state)
    predictor.model.save_pretrained(run / "model")
    write_provenance(
        run,
        status="training",
        train_pairs=len(predictor.pairs["train"]),
        epochs=len(history.rows),
        training_seconds=round(sum(row["seconds"] for row in history.rows), 1),
    )
    return True


def _checkpoint(directory: Path, name: str, **options: Any) -> ModelCheckpoint:
    """A checkpoint of fixed name, written at epoch ends only."""
    return ModelCheckpoint(directory, name, save_on_train_epoch_end=True, enable_version_counter=False, **options)


def quiet() -> None:
    """Silences Lightning's advice about loaders, loggers and workers, none of which applies here."""
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module="lightning")
    warnings.filterwarnings("ignore", category=FutureWarning)
