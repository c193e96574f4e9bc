"""Files of bags as rosbags can open them: any name, several parts, and databases that were not closed."""

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from repro.system.errors import InputError

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
            paths = [_readable(part, Path(directory) / str(number)) for number, part in enumerate(_parts(path))]
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


def _parts(path: Path) -> list[Path]:
    """Return the paths that together are a bag, in the order of their names, or refuse a directory without one."""
    if path.is_file():
        return [path]
    files = sorted(path.iterdir())[:MAX_FILES]
    metadata = path / "metadata.yaml"
    if metadata not in files:
        parts = [file for file in files if file.is_file() and _suffix_of(_head(file))]
        if not parts:
            raise InputError(f"{path}: is a directory without metadata.yaml and without parts of a bag")
        return parts
    for file in files:
        if not file.is_file():
            raise InputError(f"{file}: expected a regular file in the directory of a bag")
    if metadata.stat().st_size > MAX_METADATA_BYTES:
        raise InputError(f"{metadata}: has more than {MAX_METADATA_BYTES} bytes")
    return [path]


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


def _suffix_of(head: bytes) -> str | None:
    """Return the suffix that rosbags expects of a file that begins with these bytes; None if it is no bag."""
    return SUFFIXES.get(head[:7])


def _readable(path: Path, scratch: Path) -> Path:
    """Return a path that rosbags can open: with the suffix of the content, and without a log of late messages."""
    is_file = path.is_file()
    for file in [path] if is_file else path.iterdir():
        _check(file)
    scratch.mkdir()
    names = {path: f"bag{_suffix_of(_head(path))}"} if is_file else {file: file.name for file in path.iterdir()}
    if not any(map(_has_log, names)) and (not is_file or path.suffix == Path(names[path]).suffix):
        return path
    for file, name in names.items():
        if _has_log(file):
            _merge(file, scratch / name)
        elif not name.endswith(("-wal", "-shm")):
            (scratch / name).symlink_to(file.absolute())
    return scratch / names[path] if is_file else scratch


def _check(path: Path) -> None:
    """Refuse an MCAP of another profile than ROS 2, which rosbags would misread, or a database that ends in a page."""
    head = _head(path)
    if len(head) < HEAD_BYTES:
        return
    if _suffix_of(head) == ".mcap":
        length = int.from_bytes(head[PROFILE_START - 4 : PROFILE_START], "little")
        profile = head[PROFILE_START:][:length].decode(errors="replace")
        if profile != "ros2":
            raise InputError(
                f"{path}: expected an MCAP with the profile 'ros2', got {profile!r}: give the .bag of ROS 1 that "
                "it was made from, or convert that with rosbags-convert"
            )
    if _suffix_of(head) == ".db3" and path.stat().st_size % int.from_bytes(head[PAGE_SIZE], "big"):
        raise InputError(f"{path}: the bag is truncated: repair it, such as with ros2 bag reindex")


def _has_log(path: Path) -> bool:
    """Return whether a database has a write-ahead log, with its last messages, as if the recorder was killed."""
    log = path.with_name(f"{path.name}-wal")
    return log.is_file() and log.stat().st_size > 0


def _merge(path: Path, target: Path) -> None:
    """Copy a database, and write its write-ahead log into the copy."""
    for end in ("", "-wal"):
        shutil.copyfile(path.with_name(path.name + end), target.with_name(target.name + end))
    try:
        with closing(sqlite3.connect(target)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            connection.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.Error as error:
        raise InputError(f"{path}: the log of its last messages cannot be read ({error})") from error
