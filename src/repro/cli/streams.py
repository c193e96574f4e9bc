"""Standard streams that may be closed, full, gone or of another encoding than UTF-8."""

import logging
import os
import sys


def complete_standard_streams() -> None:
    """Open closed standard streams to nothing, and replace characters that the terminal cannot show.

    Without this, the next file or pipe that is opened takes the place of a closed stream.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # takes the lowest free descriptor, this one
    logging.raiseExceptions = False  # Hydra's log may go to an output that is not read any more
    sys.stdout, sys.stderr = sys.stdout or os.fdopen(1, "w"), sys.stderr or os.fdopen(2, "w")
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


def discard_output() -> None:
    """Send what is still to be printed to nothing, after the reader of the output has gone."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, sys.stdout.fileno())
