"""Names of the logs of task=predict."""

from pathlib import Path

SUFFIXES = (".npz", ".bag", ".db3", ".mcap", ".log", ".clf", ".txt", ".gz")


def name_of(log: Path) -> str:
    """Return the name of a log without the suffixes of its kind."""
    name = log.resolve().name
    while Path(name).suffix in SUFFIXES:
        name = Path(name).stem
    return name.strip(".") or "log"
