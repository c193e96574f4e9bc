"""Run directories: what a run is, where it stands, and where it came from.

config.yaml      what decides its result, written before anything else
provenance.json  status (paused, failed, finished, evaluated), versions, hardware, commit, times, data hash
history.csv      one row an epoch
model/           best weights; `smp.from_pretrained(run / "model")` reads them anywhere
predictions.npz  probabilities of free on the test set, uint8
metrics.csv      the pooled metrics, one row
per_image.csv    the same for every test image
"""

import json
import os
import platform
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from filelock import FileLock, Timeout

_PACKAGES = ("repro", "torch", "lightning", "segmentation-models-pytorch", "piqa", "ir-sim", "numpy")


def run_directory(outputs: Path, experiment: str, model: str, decay: bool, seed: int) -> Path:
    """Where a run lives: outputs/runs/exp3/unet/decay/seed0."""
    return outputs / "runs" / f"exp{experiment}" / model / ("decay" if decay else "no-decay") / f"seed{seed}"


def prepare_run(run: Path, config: dict[str, Any]) -> None:
    """Makes a run directory and its config.yaml, or checks that the one there is the same run.

    Raises:
        ValueError: the directory holds a run of another configuration; the message names the differences.
    """
    path = run / "config.yaml"
    if not path.is_file():
        run.mkdir(parents=True, exist_ok=True)
        replace_file(path, yaml.safe_dump(config, sort_keys=False))
        return
    there, wanted = _flatten(read_config(run)), _flatten(config)
    differ = [key for key in there | wanted if there.get(key) != wanted.get(key)]
    if differ:
        listing = "; ".join(f"{key} is {there.get(key)}, asked for {wanted.get(key)}" for key in differ)
        raise ValueError(f"{run} holds a run of another configuration ({listing}): delete it or set outputs=")


def read_config(run: Path) -> dict[str, Any]:
    """Reads the configuration of a run.

    Raises:
        ValueError: `run` is no run directory.
    """
    path = run / "config.yaml"
    if not path.is_file():
        raise ValueError(f"{run} is no run directory: it has no config.yaml")
    return yaml.safe_load(path.read_text())


def read_provenance(run: Path) -> dict[str, Any]:
    """Reads where a run came from; empty when it has not got so far."""
    path = run / "provenance.json"
    return json.loads(path.read_text()) if path.is_file() else {}


def read_status(run: Path) -> str | None:
    """paused, failed, finished, evaluated, or None for a run that was never written up."""
    return read_provenance(run).get("status")


def write_provenance(run: Path, *, status: str, **facts: Any) -> None:
    """Adds facts to provenance.json, with versions, hardware and commit; an error goes when the status does."""
    content = {**read_provenance(run), "status": status, **facts, **_surroundings()}
    if status != "failed":
        content.pop("error", None)
    replace_file(run / "provenance.json", json.dumps(content, indent=1))


@contextmanager
def lock(directory: Path) -> Iterator[None]:
    """Keeps a second process waiting, and saying so, until the first has done its part in a directory."""
    guard = FileLock(directory / ".lock")
    try:
        guard.acquire(timeout=0)
    except Timeout:
        print(f"waiting: another process works in {directory}", flush=True)
        guard.acquire()
    try:
        yield
    finally:
        guard.release()


def replace_file(path: Path, text: str) -> None:
    """Writes a file whole or not at all, however the process ends."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text)
    os.replace(temporary, path)


def hardware() -> dict[str, Any]:
    """What the process runs on."""
    import torch

    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    return {"machine": platform.machine(), "cpu_cores": os.cpu_count(), "gpu": gpu}


def _surroundings() -> dict[str, Any]:
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in _PACKAGES},
        "hardware": hardware(),
        "commit": _commit(),
    }


def _commit() -> str | None:
    """The commit of the source, with `+` when the tree has changes; None outside a checkout."""
    where = Path(__file__).parent
    git = ["git", "-C", str(where)]
    try:
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout
        dirty = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    return head.strip() + ("+" if dirty.strip() else "")


def _flatten(config: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in config.items():
        flat |= _flatten(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat
