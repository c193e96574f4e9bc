"""task=predict: maps from a log of your own robot."""

from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task


def run(job: Job) -> None:
    """Predict the map at the end of every window of the log."""
    from repro.prediction.readers import kind_of

    kind_of(Path(str(job.call.scans)))  # refuses other files before the slower imports
    from repro.cli.prediction import predict_log

    predict_log(job)


TASK = Task(
    run,
    names_scale=False,
    needs="scans",
    own=("scans", "prediction"),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings", "runtime"),
    instead="prediction.weights chooses the network",
)
