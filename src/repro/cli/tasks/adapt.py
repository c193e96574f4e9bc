"""task=adapt: adapt a network to logs of your own wide lidar."""

from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task


def run(job: Job) -> None:
    """Adapt the network `prediction.weights` to logs and write it to a new directory in the outputs."""
    print(f"loading PyTorch and {job.call.prediction.weights}, then the logs", flush=True)
    from repro.cli.adaptation import adapt_to_logs  # takes seconds

    adapt_to_logs(job)


def _target(job: Job) -> Path:
    from repro.cli.adaptation import target_of

    return target_of(job)


TASK = Task(
    run,
    target=_target,
    names_scale=False,
    own=("adaptation", "prediction"),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings"),
    instead="prediction.weights chooses the network",
)
