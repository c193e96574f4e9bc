"""Errors as messages: which are the user's to mend, and in what words. A fault of ours keeps its traceback."""

import errno
import traceback
from pathlib import Path

SOURCE = str(Path(__file__).parent)
_MENDS = {
    errno.ENOSPC: "make room on the disk; what was whole stays whole, and the same command goes on",
    errno.EDQUOT: "make room within the quota; what was whole stays whole, and the same command goes on",
    errno.EROFS: "choose a place that can be written with outputs=",
    errno.EACCES: "choose a place that can be written with outputs=",
    errno.EPERM: "choose a place that can be written with outputs=",
    errno.ENOTDIR: "a file stands where a directory is needed: move it away or choose another outputs=",
    errno.EEXIST: "a file stands where a directory is needed: move it away or choose another outputs=",
    errno.EISDIR: "a directory stands where a file is needed: move it away or choose another outputs=",
}


_doing: list[str] = []


def announce(what: str) -> None:
    """Says what begins now, and remembers it for when it is interrupted."""
    _doing[:] = [what]
    print(what, flush=True)


def stopped() -> str:
    """Says what was interrupted and that nothing is lost."""
    return f"stopped{' while ' if _doing else ''}{''.join(_doing)}: the same command goes on from here"


class JobFailed(Exception):
    """A job that failed and has already said why."""


def explain(error: BaseException) -> str | None:
    """Finds the words for an error that is the user's to mend.

    Args:
        error: what was raised.

    Returns:
        one message, or None for a fault of ours or of a library, whose traceback is worth seeing.
    """
    if isinstance(error, OSError) and error.errno in _MENDS:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror)
        return f"{what}: {_MENDS[error.errno]}"
    if type(error).__name__ in ("TerminatedWorkerError", "BrokenProcessPool"):
        return (
            "a worker process was killed, perhaps for want of memory: type it again, with runtime.workers=1 if need be"
        )
    if isinstance(error, (ValueError, FloatingPointError)) and _is_raised_by_us(error):
        return str(error)
    return None


def _is_raised_by_us(error: BaseException) -> bool:
    """Says whether the innermost frame of an error, in a worker process if it came from one, is of this package."""
    if type(error.__cause__).__name__ == "_RemoteTraceback":
        places = [line for line in str(error.__cause__).splitlines() if line.strip().startswith("File ")]
        return bool(places) and SOURCE in places[-1]
    frames = traceback.extract_tb(error.__traceback__)
    return bool(frames) and frames[-1].filename.startswith(SOURCE)
