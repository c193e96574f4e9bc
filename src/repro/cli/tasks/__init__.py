"""The tasks, one module each, which states what is known of it in a `Task`, and imports what is slow when it runs."""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class Task:
    """What is known of a task before it runs.

    Args:
        run: the function that does it, with the resolved job of a call.
        place: what a job writes: a run, of the windows of the call's experiment, recordings, or other outputs.
        once: whether it is done once for all runs of an outputs directory, so that it cannot be swept.
        trains: whether it trains networks.
        names_scale: whether a scale that was not chosen is worth a line.
        needs: the key that must be set.
        own: keys that only this task, and others that name them, use.
        ignores: keys without effect.
        instead: why they have none.
        target: the place that a job of a sweep alone may write to, given the job; None if it does not matter.
    """

    run: Callable[[Any], None]
    place: Literal["run", "recordings", "outputs"] = "outputs"
    once: bool = False
    trains: bool = False
    names_scale: bool = True
    needs: str = ""
    own: tuple[str, ...] = ()
    ignores: tuple[str, ...] = ()
    instead: str = ""
    target: Callable[[Any], Path] | None = None


NETWORK_KEYS = ("model", "encoding", "decay", "oldest_gray", "seed", "train")  # that choose a network of the study


@cache
def tasks() -> dict[str, Task]:
    """Return all tasks by their names, those of the modules of this package."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return {name: importlib.import_module(f"{__name__}.{name}").TASK for name in names}


@cache
def summaries() -> dict[str, str]:
    """Return the first line of the documentation of every task, by its name."""
    modules = {name: importlib.import_module(f"{__name__}.{name}") for name in tasks()}
    return {name: str(module.__doc__).splitlines()[0].partition(": ")[2] for name, module in modules.items()}


def keys_without_effect(task: str, overrides: list[str]) -> list[str]:
    """Return which overrides a task does not use, each with the reason."""
    facts = tasks()[task]
    reasons = {key: f"has no effect with task={task}, {facts.instead}" for key in facts.ignores}
    for key in sorted({key for task in tasks().values() for key in task.own} - set(facts.own)):
        users = [name for name, task in tasks().items() if key in task.own]
        reasons[key] = f"is for task={', '.join(users)} only"
    written = {override: override.lstrip("+~").partition("=")[0] for override in overrides}
    return [
        f"{override}: {reason}"
        for override, name in written.items()
        for key, reason in reasons.items()
        if name == key or name.startswith(f"{key}.")
    ]
