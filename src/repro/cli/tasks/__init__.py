"""The tasks, one module each: `run(job)` does what `task=<module>` asks for. A module is imported when it is called."""

import importlib

from repro.cli.jobs import Job


def run_task(job: Job, task: str | None = None) -> None:
    """Run the task of a job, or another task of the same run."""
    importlib.import_module(f"repro.cli.tasks.{task or job.call.task}").run(job)
