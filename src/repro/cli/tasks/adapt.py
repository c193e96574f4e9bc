"""task=adapt: adapt a network to logs of your own wide lidar."""

from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task
from repro.cli.tasks.predict import name_of


def run(job: Job) -> None:
    """Adapt the network `prediction.weights` to logs and write it to a new directory in the outputs."""
    print(f"loading PyTorch and {job.call.prediction.weights}, then the logs", flush=True)
    from repro.cli.log_adaptation import adapt_to_logs  # takes seconds

    adapt_to_logs(job, target_of(job))


def target_of(job: Job) -> Path:
    """Return the directory of the adapted network of a call."""
    settings = job.call.adaptation
    return job.outputs.path / "adapted" / (settings.name or name_of(*map(Path, settings.logs or ())))


TASK = Task(
    run,
    target=target_of,
    names_scale=False,
    needs="adaptation.logs",
    own=("adaptation", "prediction"),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings"),
    instead="prediction.weights chooses the network",
)
