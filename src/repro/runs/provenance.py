"""Status and provenance of a run: the time, software, hardware and commit of each of its steps."""

import enum
import os
import platform
import subprocess
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from repro.system.errors import InputError
from repro.system.project import project_directory

OWN = "dynamic-map-prediction"
PACKAGES = ("torch", "lightning", "segmentation-models-pytorch", "piqa", "ir-sim", "numpy")


class Status(enum.StrEnum):
    """Status of a run directory."""

    prepared = "prepared"  # it has its config.yaml
    training = "training"  # a process is training it, or was killed while training
    paused = "paused"  # at the end of an epoch, when its time budget was used up
    failed = "failed"  # the loss was not finite
    trained = "trained"  # it has its best weights
    evaluated = "evaluated"  # it has its metrics on the test set


@dataclass(frozen=True)
class Provenance:
    """Status and history of a run.

    Args:
        status: the current status.
        error: why the run failed; None if it did not.
        steps: one entry per step (recorded, trained, evaluated) with its environment. A paused training has one entry
            per call. Later calls do not overwrite earlier entries.
    """

    status: Status = Status.prepared
    error: str | None = None
    steps: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        kinds: dict[str, Any] = {
            "step": str,
            "files": dict,
            "commit": (str, type(None)),
            "recordings": str,
            "weights_sha256": str,
        }
        for step in self.steps:
            if wrong := [name for name, kind in kinds.items() if name in step and not isinstance(step[name], kind)]:
                raise InputError(f"a step has a wrong {wrong[0]}: {step[wrong[0]]!r}")
            if "step" not in step:
                raise InputError("a step has no name")

    def fact(self, name: str) -> Any:
        """Return the latest value of a fact among all steps; None if no step has it."""
        return next((step[name] for step in reversed(self.steps) if name in step), None)

    def last(self, name: str) -> dict[str, Any] | None:
        """Return the latest step of a name; None if there is none."""
        return next((step for step in reversed(self.steps) if step["step"] == name), None)


def changed_since(step: dict[str, Any] | None) -> str:
    """Return that the code has another commit than in a step, for the end of a message; empty if it has not."""
    before, now = (step or {}).get("commit"), _commit()
    if not before or not now or before.rstrip("+") == now.rstrip("+"):
        return ""
    return f" (with the code of commit {before[:8]}, now {now[:8]}: delete the run to train it again)"


def environment() -> dict[str, Any]:
    """Describe the environment of a step: time, Python, packages, hardware, commit."""
    from repro.runs.devices import hardware  # torch is slow to import, and recording does not need it

    versions = {name: found for name in PACKAGES if (found := _version(name))}
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "versions": {"repro": _version(OWN) or "not installed"} | versions,  # then the commit says more
        "hardware": hardware(),
        "commit": _commit(),
    }


def _version(package: str) -> str | None:
    """Return the version of a package; None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Return the commit of the source, with `+` if the working tree has changes.

    Outside a checkout, return the environment variable REPRO_COMMIT, which is set for code that was copied without its
    Git history, else None. A copy or an installation may lie in another repository, whose commit says nothing.
    """
    root = project_directory()
    git = ["git", "-C", str(root)]
    try:
        if not (root / ".git").exists():  # a file in a linked working tree
            raise FileNotFoundError
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout
        dirty = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return os.environ.get("REPRO_COMMIT") or None
    return head.strip() + ("+" if dirty.strip() else "")
