"""Files that the user names, and names from files."""

from pathlib import Path

from repro.cli.jobs import ROOT
from repro.networks.weights import DIRECTORY as WEIGHTS
from repro.networks.weights import NAMES
from repro.system.errors import InputError

LOG_SUFFIXES = (".npz", ".bag", ".db3", ".mcap", ".log", ".clf", ".txt", ".gz")


def find(key: str, name: str) -> Path:
    """Return the path that a key names; it may be relative to the project, and weights may have a name alone.

    Raises:
        ValueError: there is none.
    """
    for path in (*(WEIGHTS / known for known in NAMES if known == name), Path(name), ROOT / name):
        if path.is_file() or path.is_dir():  # no pipe, which would wait, and no device
            return path
    raise InputError(f"{key}: {name}: no such file or directory")


def name_of(log: Path) -> str:
    """Return the name of a log without the suffixes of its kind."""
    name = log.resolve().name
    while Path(name).suffix in LOG_SUFFIXES:
        name = Path(name).stem
    return name.strip(".") or "log"
