"""Files of bags as rosbags can open them: any name, several parts, and databases that were not closed."""

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from repro.system.errors import InputError
from repro.system.files import first_line

SUFFIXES = {b"#ROSBAG": ".bag", b"\x89MCAP0\r": ".mcap", b"SQLite ": ".db3"}  # by the first seven bytes
HEAD_BYTES = 64
PROFILE_START = 21  # of the name in an MCAP, after its magic and the head of its first record [bytes]
PAGE_SIZE = slice(16, 18)  # of the number in the head of a database
MAX_FILES = 1000  # of one bag
MAX_METADATA_BYTES = 10**7


@contextmanager
def open_bag(path: Path) -> Iterator[AnyReader]:
    """Open a bag.

    Args:
        path: a file, the directory of a ROS 2 bag, or a directory with the parts of a bag and no metadata.yaml.

    Raises:
        InputError: it cannot be read, also while the context reads from it.
    """
    with tempfile.TemporaryDirectory() as directory:
        try:
            parts = bag_parts(path)
            for part in parts:
                for file in part.iterdir() if part.is_dir() else [part]:
                    _check_head(file)
            paths = [_readable(part, Path(directory) / str(number)) for number, part in enumerate(parts)]
            with AnyReader(paths, default_typestore=get_typestore(Stores.LATEST)) as bag:
                yield bag
        except InputError:
            raise
        except Exception as error:  # rosbags and its storages raise many types for damaged files
            problem = f"{type(error).__name__}: {error}" if str(error) else "it is truncated or damaged"
            raise InputError(
                f"{path}: the bag cannot be read ({problem}): if its messages are compressed, give its directory with "
                "metadata.yaml; if its recording was cut off, repair it, such as with rosbag reindex, ros2 bag reindex "
                "or mcap recover"
            ) from error


def bag_parts(path: Path) -> list[Path]:
    """Return the paths that together are a bag, in the order of their names.

    Raises:
        InputError: a directory has no bag, or is one with a part that is no regular file.
    """
    if path.is_file():
        return [path]
    files = sorted(path.iterdir())[:MAX_FILES]
    metadata = path / "metadata.yaml"
    if metadata in files:
        for file in files:
            if not file.is_file():
                raise InputError(f"{file}: expected a regular file in the directory of a bag")
        if metadata.stat().st_size > MAX_METADATA_BYTES:
            raise InputError(f"{metadata}: has more than {MAX_METADATA_BYTES} bytes")
        return [path]
    parts = [file for file in files if file.is_file() and kind_of(file)]
    if not parts:
        raise InputError(f"{path}: is a directory without metadata.yaml and without parts of a bag")
    return parts


def kind_of(path: Path) -> str | None:
    """Return the suffix that rosbags expects of a file with this content; None if it is no bag."""
    with path.open("rb") as file:
        return SUFFIXES.get(file.read(7))


def _check_head(path: Path) -> None:
    """Check that an MCAP has messages of ROS 2, the only ones that rosbags reads from it, and that a database is whole.

    Raises:
        InputError: an MCAP names another profile, or none; or a database ends within a page, which SQLite would fill
            with zeros.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if len(head) < HEAD_BYTES:
        return
    if SUFFIXES.get(head[:7]) == ".mcap":
        length = int.from_bytes(head[PROFILE_START - 4 : PROFILE_START], "little")
        profile = head[PROFILE_START:][:length].decode(errors="replace")
        if profile != "ros2":
            raise InputError(
                f"{path}: expected an MCAP with the profile 'ros2', got {profile!r}: give the .bag of ROS 1 that "
                "it was made from, or convert that with rosbags-convert"
            )
    if SUFFIXES.get(head[:7]) == ".db3" and path.stat().st_size % int.from_bytes(head[PAGE_SIZE], "big"):
        raise InputError(f"{path}: the bag is truncated: repair it, such as with ros2 bag reindex")


def _readable(path: Path, scratch: Path) -> Path:
    """Return a path that rosbags can open: with the suffix of the content, and without a log of late messages."""
    scratch.mkdir()
    if path.is_file():
        link = scratch / f"bag{kind_of(path)}"
        if _log_of(path):
            _merge(path, link)
        elif path.suffix == link.suffix:
            return path
        else:
            link.symlink_to(path.absolute())
        return link
    if not any(_log_of(file) for file in path.glob("*.db3")):
        return path
    for file in path.iterdir():
        if file.suffix == ".db3" and _log_of(file):
            _merge(file, scratch / file.name)
        elif not file.name.endswith(("-wal", "-shm")):
            (scratch / file.name).symlink_to(file.absolute())
    return scratch


def _log_of(path: Path) -> Path | None:
    """Return the write-ahead log of a database, which has its last messages if the recorder was killed."""
    log = path.with_name(f"{path.name}-wal")
    return log if log.is_file() and log.stat().st_size else None


def _merge(path: Path, target: Path) -> None:
    """Copy a database, and write its log into the copy.

    Raises:
        InputError: the copy does not fit on the disk of temporary files, or SQLite cannot read the database.
    """
    log = _log_of(path)
    assert log is not None, "the caller found it"
    needed, free = path.stat().st_size + 2 * log.stat().st_size, shutil.disk_usage(target.parent).free
    if needed > free:
        raise InputError(
            f"{path}: its last messages are in {log.name}, and the copy that merges them needs {needed / 1e9:.3g} GB "
            f"in {tempfile.gettempdir()}, where {free / 1e9:.3g} are free"
        )
    shutil.copyfile(path, target)
    shutil.copyfile(log, target.with_name(f"{target.name}-wal"))
    try:
        connection = sqlite3.connect(target)
        try:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            connection.execute("PRAGMA journal_mode=DELETE")
        finally:
            connection.close()
    except sqlite3.Error as error:
        raise InputError(f"{path}: the log of its last messages cannot be read ({first_line(error)})") from error
