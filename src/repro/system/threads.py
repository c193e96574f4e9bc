"""Threads of compiled loops and of networks on the CPU: one, unless the user has chosen another number.

Threads wait for one another: beside other work on the same cores, two were 40 times as slow as one. OMP_NUM_THREADS
chooses another number, or a call of `use_threads`.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from repro.system.errors import InputError


def _number_in(value: str) -> int:
    """Return the number of threads in OMP_NUM_THREADS, the first of a list; 1 if it is none, as for OpenMP."""
    first = value.partition(",")[0].strip()
    return max(int(first), 1) if first.isdecimal() and len(first) < 6 else 1


_threads = _number_in(os.environ.get("OMP_NUM_THREADS", "1"))


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


class OneAtATime:
    """A context that one thread enters at a time, and none a second time, as a signal handler would wait for ever.

    Args:
        name: of what is done in it, for the message.

    Raises:
        InputError: the thread is in it already.
    """

    def __init__(self, name: str) -> None:
        self.name, self._is_entered, self._lock = name, False, threading.RLock()

    def __reduce__(self) -> tuple[type, tuple[str]]:
        """Return what makes a copy, which nobody has entered."""
        return OneAtATime, (self.name,)

    def __enter__(self) -> None:
        self._lock.acquire()
        if self._is_entered:
            self._lock.release()
            raise InputError(f"{self.name} runs in this thread already: expected no call from a signal handler")
        self._is_entered = True

    def __exit__(self, *_: object) -> None:
        self._is_entered = False
        self._lock.release()
