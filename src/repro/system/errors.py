"""The error that the user can fix, as opposed to errors of this package or of a library."""

STUDY = "make setup in a clone, or pip install 'dynamic-map-prediction[study]'"  # installs what the study needs


class InputError(ValueError):
    """Something that was given cannot be used: a value, a file, a run; the message states what was expected.

    The command line shows its message without a traceback, and where one of several inputs may be left out, only this
    error leaves it out.
    """


def printable(text: str) -> str:
    """Return a text whose control characters, as in names of others, cannot control a terminal."""
    return "".join(sign if sign.isprintable() or sign == "\n" else ascii(sign)[1:-1] for sign in text)
