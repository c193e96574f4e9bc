"""Names from the files that the user names."""

from pathlib import Path

LOG_SUFFIXES = (".npz", ".bag", ".db3", ".mcap", ".log", ".clf", ".txt", ".gz")


def name_of(log: Path) -> str:
    """Return the name of a log without the suffixes of its kind."""
    name = log.resolve().name
    while Path(name).suffix in LOG_SUFFIXES:
        name = Path(name).stem
    return name.strip(".") or "log"
