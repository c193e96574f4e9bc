"""Progress with the remaining time: a bar on a terminal, and a line now and then in a log."""

import io
import multiprocessing
import sys
from collections.abc import Iterable
from typing import Any

from tqdm import tqdm

LINE_S = 20.0  # between two lines in a log
LINE = "{desc}: {n_fmt} of {total_fmt}, {elapsed} passed, {remaining} left"
WITHOUT_TOTAL = "{desc}: {n_fmt}, {elapsed} passed"


class _Lines(tqdm):
    """Prints lines, where a bar would fill a log with its states."""

    pos, last_print_t, start_t = 0, 0.0, 0.0  # for the end of one that Ctrl-C interrupts before it has them

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Print a line; the last call has an empty message."""
        if msg is None:
            self.bar_format = LINE if self.total else WITHOUT_TOTAL
            print(self, file=sys.stderr, flush=True)


def progress(items: Iterable[Any] | None = None, description: str = "", **options: Any) -> tqdm:
    """Show the progress of a step that takes more than some seconds.

    Args:
        items: what is done one after another; None if `update` of the returned bar is called.
        description: what is done.
        options: further options of tqdm, such as `total`.
    """
    options |= {"desc": description, "leave": False}
    if sys.stderr.isatty() and multiprocessing.parent_process() is None:  # no bars of several workers
        return tqdm(items, delay=2, **options)
    options |= {"mininterval": LINE_S, "delay": LINE_S, "miniters": 1}
    return _Lines(items, file=io.StringIO(), **options)
