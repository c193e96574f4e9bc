"""Checkpoints that survive interruptions: atomic writes, checksums verified before a resume."""

import io
import logging
import pickle
import shutil
import zipfile
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch import nn

from repro.learning.networks.trained import load_trained, module_of
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, replacing

log = logging.getLogger(__name__)


class WholeCheckpointIO(TorchCheckpointIO):
    """Checkpoint writer that replaces a file atomically."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        content = io.BytesIO()
        torch.save(checkpoint, content)
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content.getbuffer())


def resume_from(directory: Path) -> Path | None:
    """Return the checkpoint to resume from, or None to restart the training.

    A resume also needs intact best weights. Without them the checkpoints are deleted and the training restarts; a
    restarted training ends with the same numbers.

    Args:
        directory: directory with the checkpoints of a run.
    """
    clear_leftovers(directory)
    last = directory / "last.ckpt"
    if not last.is_file():
        return None
    if _is_intact(last) and find_best(directory):
        return last
    log.warning("no intact checkpoint in %s: the training restarts", directory)
    shutil.rmtree(directory)
    return None


def find_best(directory: Path) -> Path | None:
    """Return the checkpoint of the best weights; None if it is missing or damaged."""
    best = directory / "best.ckpt"
    return best if best.is_file() and _is_intact(best) else None


def _is_intact(path: Path) -> bool:
    """Check that a checkpoint agrees with its checksums and holds tensors and plain values only; print why not."""
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
        if not damaged:
            torch.load(path, map_location="cpu", weights_only=True)
    except (zipfile.BadZipFile, OSError, EOFError, ValueError, RuntimeError, pickle.UnpicklingError) as error:
        damaged = str(error).split("\n")[0]
    if damaged:
        log.warning("skipping the damaged checkpoint %s (%s)", path, damaged)
    return not damaged


def start_from(network: nn.Module, weights: str) -> None:
    """Load the weights of another network into a network of the same form.

    What the other network lacks and has no effect yet, since its weights are zero, stays so.

    Raises:
        InputError: there are no such weights, or they are of a network of another form.
    """
    try:
        without_effect = {name: values for name, values in network.state_dict().items() if not values.any()}
        network.load_state_dict(without_effect | module_of(load_trained(weights)).state_dict())
    except RuntimeError as error:
        first = " ".join(str(error).split())[:200]  # of a line for every weight
        raise InputError(
            f"train.weights={weights}: expected a network of the same form, got another: {first}"
        ) from error
