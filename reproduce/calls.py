"""Calls of the scripts of this directory: errors in the input are one line, as on the command line of the library."""

import argparse
import sys
from collections.abc import Callable

from repro.system.errors import InputError


def reported(main: Callable[[], None]) -> None:
    """Call a script, and end with the message of an `InputError`."""
    try:
        main()
    except InputError as error:
        sys.exit(f"error: {error}")


def positive(text: str) -> int:
    """Return the whole number of an argument, 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, got {text!r}")
    return int(text)
