"""Which errors are the user's to fix, and their messages. Errors of our own or of a library keep their traceback."""

import errno
import os
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any

from repro.system.errors import STUDY, InputError


class Refused(InputError):
    """A call that cannot be run; its arguments are the reasons, one line each."""


WANTS_TRACEBACKS = bool(os.environ.get("HYDRA_FULL_ERROR"))
_FREE_SPACE = "free some space and repeat the command; complete files stay complete"
_WRITABLE = "choose a directory that can be written with outputs="
_UNUSABLE = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.ELOOP)
_FIXES = dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), _FREE_SPACE) | dict.fromkeys(
    (*_UNUSABLE, errno.ENAMETOOLONG), _WRITABLE
)


def explain(error: BaseException) -> str | None:
    """Return the message of an error that the user can fix.

    Returns:
        one message; None for an error of our own or of a library, whose traceback is needed.
    """
    if isinstance(error, FileNotFoundError) and str(error.filename).startswith(("/proc/", "/sys/")):
        return f"{error.filename}: {error.strerror}: {_WRITABLE}"
    if isinstance(error, OSError) and error.errno in _FIXES:
        file = f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror)
        return f"{file}: {_FIXES[error.errno]}"
    if type(error).__name__ in ("TerminatedWorkerError", "BrokenProcessPool"):
        return "a worker process was killed, perhaps for lack of memory: repeat the command with runtime.workers=1"
    if isinstance(error, ModuleNotFoundError) and not str(error.name).startswith("repro"):
        return f"this needs the study, of which {error.name} is missing: {STUDY}"
    if isinstance(error, InputError | FloatingPointError):
        return str(error)
    return None


def did_you_mean(key: str, values: dict[str, Any]) -> str:
    """Return the keys of a nested mapping that an unknown key may have meant, for the end of a message."""
    above, _, name = key.rpartition(".")
    others = {other: other.rpartition(".") for other in _keys(values) if other != key}
    beside = {last: other for other, (parent, _, last) in others.items() if parent == above}
    near = [beside[other] for other in get_close_matches(name, beside, 1)]
    near = near or [other for other, (_, _, last) in others.items() if last == name][:2]
    return f"; did you mean {' or '.join(near)}?" if near else f"; known are {', '.join(beside)}" if beside else ""


def _keys(values: Any, prefix: str = "") -> Iterator[str]:
    """Yield all keys of nested mappings and lists, with dots."""
    items = values.items() if isinstance(values, dict) else enumerate(values if isinstance(values, list) else ())
    for key, value in items:
        yield f"{prefix}{key}"
        yield from _keys(value, f"{prefix}{key}.")
