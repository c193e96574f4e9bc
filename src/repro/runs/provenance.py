"""Where a run directory stands, and where and with what each of its steps was done."""

import enum
import os
import platform
import subprocess
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

PACKAGES = ("repro", "torch", "lightning", "segmentation-models-pytorch", "piqa", "ir-sim", "numpy")


class Status(enum.StrEnum):
    """Where a run directory stands."""

    prepared = "prepared"  # it has its config.yaml
    training = "training"  # a process trains it, or was killed doing so
    paused = "paused"  # at an epoch's end, by its budget
    failed = "failed"  # the loss was not finite
    trained = "trained"  # it has its best weights
    evaluated = "evaluated"  # it has its metrics on the test set


@dataclass(frozen=True)
class Provenance:
    """Where a run stands and where it came from.

    Args:
        status: the status now.
        error: what made it fail, when it did.
        steps: one entry for each step taken (recorded, trained, evaluated), each with its environment. A training
            that was paused has an entry for every call. None is ever overwritten.
    """

    status: Status = Status.prepared
    error: str | None = None
    steps: list[dict[str, Any]] = field(default_factory=list)

    def fact(self, name: str) -> Any:
        """Finds the latest value of a fact among all steps; None if no step has it."""
        return next((step[name] for step in reversed(self.steps) if name in step), None)


def environment() -> dict[str, Any]:
    """Describes what a step is done with: time, Python, packages, hardware, commit."""
    from repro.system.devices import hardware  # torch is slow to import, and recording does without

    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "hardware": hardware(),
        "commit": _commit(),
    }


def _commit() -> str | None:
    """Reads the commit of the source, with `+` when the tree has changes.

    Outside a checkout it is what REPRO_COMMIT says, for code that was copied without its history, else None.
    """
    git = ["git", "-C", str(Path(__file__).parent)]
    try:
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout
        dirty = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return os.environ.get("REPRO_COMMIT") or None
    return head.strip() + ("+" if dirty.strip() else "")
