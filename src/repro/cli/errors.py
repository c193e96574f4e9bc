"""Which errors are the user's to fix, and their messages. Errors of our own or of a library keep their traceback."""

import errno
import os

from repro.system.errors import InputError


class Refused(InputError):
    """A call that cannot be run; its arguments are the reasons, one line each."""


WANTS_TRACEBACKS = bool(os.environ.get("HYDRA_FULL_ERROR"))
_FREE_SPACE = "free some space and repeat the command; complete files stay complete"
_PERMITTED = "check its permissions; results are written to outputs="
_WRITABLE = "choose a directory that can be written with outputs="
_FILE_IN_THE_WAY = "a file is where a directory is needed: move it away or choose another outputs="
_FIXES = {
    errno.ENOSPC: _FREE_SPACE,
    errno.EDQUOT: _FREE_SPACE,
    errno.EFBIG: "raise the limit on the size of files (ulimit -f) and repeat the command",
    errno.EROFS: _WRITABLE,
    errno.EACCES: _PERMITTED,
    errno.EPERM: _PERMITTED,
    errno.ELOOP: _WRITABLE,
    errno.ENAMETOOLONG: "choose a shorter path",
    errno.ENOTDIR: _FILE_IN_THE_WAY,
    errno.EEXIST: _FILE_IN_THE_WAY,
    errno.EISDIR: "a directory is where a file is needed: move it away or choose another outputs=",
}


def explain(error: BaseException) -> str | None:
    """Return the message of an error that the user can fix.

    Args:
        error: what was raised.

    Returns:
        one message; None for an error of our own or of a library, whose traceback is needed.
    """
    if isinstance(error, OSError) and error.errno in _FIXES:
        file = f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror)
        return f"{file}: {_FIXES[error.errno]}"
    if type(error).__name__ in ("TerminatedWorkerError", "BrokenProcessPool"):
        return "a worker process was killed, perhaps for lack of memory: repeat the command with runtime.workers=1"
    if isinstance(error, InputError | FloatingPointError):
        return str(error)
    return None
