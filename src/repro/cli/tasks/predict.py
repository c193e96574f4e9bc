"""task=predict: maps from a log of your own robot."""

import hashlib
import os
from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task

LONGEST_NAME = 180  # bytes of the name of a log


def run(job: Job) -> None:
    """Predict the map at the end of every window of the log."""
    assert job.call.scans, "validated"
    print(f"loading {job.call.prediction.weights}, then {' and '.join(map(str, job.call.scans))}", flush=True)
    from repro.cli.log_prediction import predict_log  # takes seconds

    predict_log(job, target_of(job))


def target_of(job: Job) -> Path:
    """Return the directory of the maps of a call."""
    return job.outputs.path / "predictions" / name_of(*map(Path, job.call.scans or ()))


def name_of(log: Path, *others: Path) -> str:
    """Return the name of a log without the suffix of its kind, and how many other files there are."""
    path = Path(os.path.realpath(log))
    name = path.name if path.is_dir() else Path(path.name.removesuffix(".gz")).stem
    name = name.strip(".") or "log"
    if len(os.fsencode(name)) > LONGEST_NAME:  # files of a prediction add to it
        name = f"{name[: LONGEST_NAME // 4]}-{hashlib.sha256(os.fsencode(name)).hexdigest()[:8]}"
    return name + (f"-and-{len(others)}-others" if others else "")


TASK = Task(
    run,
    target=target_of,
    names_scale=False,
    needs="scans",
    own=("scans", "prediction"),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings", "runtime"),
    instead="prediction.weights chooses the network",
)
