"""task=predict: maps from a log of your own robot."""

from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task


def run(job: Job) -> None:
    """Predict the map at the end of every window of the log."""
    assert job.call.scans, "validated"
    print(f"loading {job.call.prediction.weights}, then {' and '.join(map(str, job.call.scans))}", flush=True)
    from repro.cli.prediction import predict_log  # takes seconds

    predict_log(job)


def _target(job: Job) -> Path:
    from repro.cli.prediction import target_of

    return target_of(job)


TASK = Task(
    run,
    target=_target,
    names_scale=False,
    needs="scans",
    own=("scans", "prediction"),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings", "runtime"),
    instead="prediction.weights chooses the network",
)
