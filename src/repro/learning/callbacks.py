"""Callbacks of a training: progress, history, early stopping, time limit."""

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lightning as L
import pandas as pd
from lightning.pytorch.callbacks import Callback, EarlyStopping, ModelCheckpoint

from repro.system.files import write_text
from repro.system.progress import progress, say


@dataclass
class Budget:
    """A time limit shared by the trainings of one process, which trains at least one epoch in any case.

    Args:
        minutes: the limit, counted from the creation of the budget [min]; None is no limit.
        since: time of creation by `time.monotonic` [s].
        epochs: number of epochs trained so far.
    """

    minutes: float | None
    since: float = field(default_factory=time.monotonic)
    epochs: int = 0

    def is_spent(self) -> bool:
        """Return whether the limit is reached."""
        return self.minutes is not None and self.epochs > 0 and time.monotonic() - self.since > 60 * self.minutes


class History(Callback):
    """Progress, and one row per epoch in history.csv.

    Checkpoints keep the rows, so that a resumed run has the complete history; after a kill, it begins with theirs.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.label = "/".join(path.parent.parts[-4:])  # several trainings of a sweep print to the same terminal
        self.since = time.monotonic()
        self.rows: list[dict[str, float]] = []

    def on_train_start(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        if self.rows:
            self._write()
            say(f"{self.label}  resuming after epoch {len(self.rows)} of {trainer.max_epochs}")

    def on_train_epoch_start(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        self.since = time.monotonic()
        name = f"{self.label}  epoch {trainer.current_epoch + 1} of {trainer.max_epochs}, batch"
        self.bar = progress(description=name, total=int(trainer.num_training_batches))

    def on_train_batch_end(self, *_: Any) -> None:
        self.bar.update()

    def on_train_epoch_end(self, trainer: L.Trainer, module: Any) -> None:
        self.bar.close()
        module.log("train_loss", module.train_loss())
        values = {name: trainer.callback_metrics[name].item() for name in ("train_loss", "val_loss")}
        if not math.isfinite(values["val_loss"]):
            raise FloatingPointError(f"the validation loss is {values['val_loss']} at epoch {trainer.current_epoch}")
        seconds = round(time.monotonic() - self.since, 2)
        self.rows.append({"epoch": trainer.current_epoch, **values, "seconds": seconds})
        self._write()
        say(
            f"{self.label}  epoch {len(self.rows)} of {trainer.max_epochs}  train {values['train_loss']:.4f}  "
            f"val {values['val_loss']:.4f}  {seconds:.1f} s"
        )

    def _write(self) -> None:
        write_text(self.path, pd.DataFrame(self.rows).to_csv(index=False))

    def state_dict(self) -> dict[str, Any]:
        return {"rows": self.rows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.rows = state["rows"]


class Stop(EarlyStopping):
    """Early stopping that keeps its decision across a resume, and the time limit of the process."""

    def __init__(self, budget: Budget | None, **options: Any) -> None:
        super().__init__("val_loss", check_on_train_epoch_end=True, **options)
        self.budget = budget or Budget(None)
        self.paused = False

    def on_train_start(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        trainer.should_stop = self.wait_count > 0 and self.wait_count >= self.patience

    def on_train_epoch_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        super().on_train_epoch_end(trainer, module)
        last = trainer.current_epoch + 1 == trainer.max_epochs
        self.budget.epochs += 1
        if self.budget.is_spent() and not trainer.should_stop and not last:
            self.paused = trainer.should_stop = True


class Checkpoint(ModelCheckpoint):
    """A checkpoint with a fixed file name that is written at the end of an epoch only.

    Its state keeps absolute paths, and Lightning forgets the best score if the directory has another path at the
    resume. This class takes the state as if it was written where the run is now.
    """

    def __init__(self, directory: Path, name: str, **options: Any) -> None:
        super().__init__(directory, name, save_on_train_epoch_end=True, enable_version_counter=False, **options)

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        directory = Path(self.dirpath or "")

        def moved(path: str) -> str:
            return str(directory / Path(path).name) if path else path

        names = ("best_model_path", "kth_best_model_path", "last_model_path")
        paths = {name: moved(state_dict[name]) for name in names if name in state_dict}
        best = {moved(path): score for path, score in state_dict.get("best_k_models", {}).items()}
        super().load_state_dict({**state_dict, **paths, "best_k_models": best, "dirpath": self.dirpath})
