"""Which errors this package raises about its input, and which are errors of its own or of a library."""

import traceback
from pathlib import Path

SOURCE = str(Path(__file__).parents[1])


def is_about_input(error: BaseException) -> bool:
    """Return whether an error was raised by a `raise` statement of this package, also if in a worker process.

    A ValueError that a library raises in compiled code, called from here, has its innermost frame in this package, too,
    but on another line.
    """
    if type(error.__cause__).__name__ == "_RemoteTraceback":
        lines = [line.strip() for line in str(error.__cause__).splitlines()]
        frames = [number for number, line in enumerate(lines) if line.startswith("File ")]
        where, line = lines[frames[-1] : frames[-1] + 2] if frames else ("", "")
    else:
        frames_here = traceback.extract_tb(error.__traceback__)
        where, line = (frames_here[-1].filename, frames_here[-1].line or "") if frames_here else ("", "")
    return SOURCE in where and line.startswith("raise ")
