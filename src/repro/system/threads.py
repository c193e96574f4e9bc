"""Threads of compiled loops and of networks in ONNX Runtime: one, unless the user has chosen another number.

Threads wait for one another: beside other work on the same cores, two were 40 times as slow as one. OMP_NUM_THREADS
chooses another number, or a call of `use_threads`.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

_threads = int(os.environ.get("OMP_NUM_THREADS", "1").partition(",")[0] or 1)


def count_threads() -> int:
    """Return the number of threads."""
    return _threads


def use_threads(number: int) -> None:
    """Choose the number of threads, of a network for one that is loaded afterwards."""
    global _threads
    _threads = number


def in_threads(draw: Callable[[np.ndarray], None], count: int) -> None:
    """Call a function that releases the interpreter with parts of the indices up to a count, one part per thread."""
    number = min(_threads, count)
    if number <= 1:
        draw(np.arange(count))  # starting a thread takes as long as drawing a window
        return
    with ThreadPoolExecutor(number) as pool:
        list(pool.map(draw, np.array_split(np.arange(count), number)))
