"""Checkpoints that survive: written whole, the one before kept, a damaged one passed over with a word."""

import io
import os
import shutil
import zipfile
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO

from repro.system.files import replacing


class WholeCheckpointIO(TorchCheckpointIO):
    """Writes a checkpoint beside its place and moves it there; what stood there before becomes <name>.before."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        content = io.BytesIO()
        torch.save(checkpoint, content)
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content.getbuffer())
            if path.is_file():
                os.replace(path, _before(path))


def resume_from(directory: Path) -> Path | None:
    """Finds the checkpoint to go on from, the last or the one before; None when the training must begin anew.

    A training that goes on must find its best weights too; where they are damaged it begins anew, which ends with the
    same numbers.

    Args:
        directory: the checkpoints of a run.
    """
    candidates = [path for path in (directory / "last.ckpt", _before(directory / "last.ckpt")) if path.is_file()]
    found = next((path for path in candidates if _is_whole(path)), None)
    if found and find_best(directory):
        return found
    if candidates:
        print(f"no whole checkpoint in {directory}: the training begins anew", flush=True)
        shutil.rmtree(directory)
    return None


def find_best(directory: Path) -> Path | None:
    """Finds the best weights; the file before only where a process was killed between moving the two."""
    best = directory / "best.ckpt"
    if not best.is_file() and _before(best).is_file():
        best = _before(best)
    return best if best.is_file() and _is_whole(best) else None


def _before(path: Path) -> Path:
    return path.with_name(path.name + ".before")


def _is_whole(path: Path) -> bool:
    """Checks a checkpoint, a zip archive, against the checksums it carries; says so where it is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
    except (zipfile.BadZipFile, OSError, EOFError, ValueError) as error:
        damaged = str(error)
    if damaged:
        print(f"passing over the damaged checkpoint {path} ({damaged})", flush=True)
    return not damaged
