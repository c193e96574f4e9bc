"""Progress with the remaining time, on a terminal and now and then in a log."""

import multiprocessing
import sys
from collections.abc import Iterable
from typing import Any

from tqdm import tqdm

LOG_S = 20.0  # between two states in a log


def progress(items: Iterable[Any] | None = None, description: str = "", **options: Any) -> tqdm:
    """Show the progress of a step that takes more than some seconds.

    Args:
        items: what is done one after another; None if `update` of the returned bar is called.
        options: further options of tqdm, such as `total`.
    """
    is_terminal = sys.stderr.isatty() and multiprocessing.parent_process() is None  # no bars of several workers
    every_s, delay_s = (0.1, 2.0) if is_terminal else (LOG_S, LOG_S)
    options |= {"desc": description, "leave": not is_terminal, "mininterval": every_s, "delay": delay_s}
    return tqdm(items, miniters=1, **options)
