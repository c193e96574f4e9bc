"""Lines and progress with the remaining time, on a terminal and now and then in a log."""

import multiprocessing
import sys
from collections.abc import Iterable, Sized
from typing import Any

from tqdm import tqdm

LOG_S = 10.0  # between two states in a log
LOG_FORMAT = "{desc}: {n_fmt} of {total_fmt} after {elapsed}, {remaining} left"


class Lines:
    """The standard error for tqdm, where every state is a line of its own, as several processes write them."""

    def write(self, text: str) -> None:
        """Write a state in one piece, and nothing for what clears a bar."""
        if state := text.strip():
            sys.stderr.write(state + "\n")

    def flush(self) -> None:
        sys.stderr.flush()


def say(line: str) -> None:
    """Print a line in one piece, since other processes may print at the same time."""
    print(line + "\n", end="", flush=True)


def progress(
    items: Iterable[Any] | None = None, description: str = "", total: int | None = None, done: int = 0
) -> tqdm:
    """Show the progress of a step that takes more than some seconds.

    Args:
        items: what is done one after another; None if `update` of the returned bar is called.
        description: what is done.
        total: number of the items, if they have no length.
        done: those that were done before.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    options: dict[str, Any] = {"desc": description, "total": total, "initial": done, "miniters": 1, "leave": False}
    if sys.stderr.isatty() and multiprocessing.parent_process() is None:  # no bars of several workers
        return tqdm(items, delay=2.0, **options)
    form = LOG_FORMAT if total is not None else None
    return tqdm(items, delay=LOG_S, mininterval=LOG_S, file=Lines(), bar_format=form, **options)
