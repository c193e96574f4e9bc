"""Compilation of loops over beams and pixels to machine code, which is kept between calls where there is a place."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable)


def compiled(function: Function) -> Function:
    """Compile a function at its first call, without the global interpreter lock.

    The machine code is kept in `__pycache__` beside the source, else in the user's cache directory, where Python or
    numba find it in the next call; if neither can be written, each process compiles anew, which takes some seconds.
    A kept function is compiled again when its own file changes, so it must call compiled functions of that file only.
    """
    try:
        dispatcher = numba.njit(function, nogil=True, cache=True)
    except RuntimeError:  # numba has no place to keep it
        dispatcher = numba.njit(function, nogil=True)
    return cast(Function, dispatcher)
