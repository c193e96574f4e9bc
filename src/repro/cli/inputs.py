"""Files that the user names."""

from pathlib import Path

from repro.cli.jobs import ROOT
from repro.networks.weights import DIRECTORY as WEIGHTS
from repro.networks.weights import NAMES
from repro.system.errors import InputError


def find(key: str, name: str) -> Path:
    """Return the path that a key names; it may be relative to the project, and weights may have a name alone.

    Raises:
        ValueError: there is none.
    """
    for path in (*(WEIGHTS / known for known in NAMES if known == name), Path(name), ROOT / name):
        if path.is_file() or path.is_dir():  # no pipe, which would wait, and no device
            return path
    raise InputError(f"{key}: {name}: no such file or directory")
