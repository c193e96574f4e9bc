"""task=adapt: adapt a network to logs of your own wide lidar."""

from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task
from repro.system.errors import InputError


def run(job: Job) -> None:
    """Adapt the network `prediction.weights` to logs and write it to a new directory in the outputs.

    Raises:
        InputError: no log is given, one cannot be used, the directory exists, or the network gets no better.
    """
    settings = job.call.adaptation
    if not settings.logs:
        raise InputError("adaptation.logs: is needed with task=adapt, such as adaptation.logs=[a.log,b.bag]")
    paths = [Path(log) for log in settings.logs]
    target = job.outputs.path / "adapted" / (settings.name or _name_of(paths))
    if target.exists():
        raise InputError(f"{target} exists: set adaptation.name to another one, or delete it")
    from repro.cli.adaptation import adapt_to_logs  # imports Lightning

    adapt_to_logs(job, paths, target)


def _name_of(paths: list[Path]) -> str:
    from repro.cli.inputs import name_of

    others = f"-and-{len(paths) - 1}-others" if len(paths) > 1 else ""
    return name_of(paths[0]) + others


TASK = Task(
    run,
    names_scale=False,
    own=("adaptation", "prediction"),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings"),
    instead="prediction.weights chooses the network",
)
