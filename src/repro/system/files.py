"""Small files: written whole or not at all, read with a message that names the file and the mend; locks, checksums."""

import hashlib
import json
import os
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml
from filelock import FileLock, Timeout
from pydantic import TypeAdapter, ValidationError

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")
LEFTOVER = re.compile(r"\.[0-9a-f]{32}\.tmp$")  # what the temporary names of this module end in


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Gives a temporary name beside `path` to write to, and moves it into place when the block ends well.

    The name is unique, so any number of processes may replace the same file; the last one wins.

    Args:
        path: the file to be made or replaced; its directory must exist.
    """
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error  # not every writer says which file it was
    finally:
        with suppress(OSError):  # of a disk that has gone
            temporary.unlink(missing_ok=True)


@contextmanager
def replacing_directory(path: Path) -> Iterator[Path]:
    """Yield an empty directory beside `path` to fill, and move it to `path` when the block ends without an error.

    A directory at `path` is moved aside first and deleted last, so that it is never lost.
    """
    new, old = (path.with_name(f"{path.name}.{uuid.uuid4().hex}.tmp") for _ in range(2))
    new.mkdir(parents=True)
    try:
        yield new
        if path.exists():
            os.replace(path, old)
        os.replace(new, path)
    except BaseException:
        if old.exists() and not path.exists():
            os.replace(old, path)
        raise
    finally:
        shutil.rmtree(new, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def clear_leftovers(directory: Path, keep: Path | None = None) -> None:
    """Delete the temporary files that killed processes left in a directory, which no other process may be using.

    Only names that this module creates are deleted.

    Args:
        directory: the directory, which the caller has locked.
        keep: a temporary file that the caller itself is writing.
    """
    for leftover in directory.glob("*.tmp"):
        if leftover == keep or not LEFTOVER.search(leftover.name):
            continue
        if leftover.is_dir() and not leftover.is_symlink():
            shutil.rmtree(leftover)
        else:
            leftover.unlink()


def write_text(path: Path, text: str) -> None:
    """Writes a text file whole or not at all, however the process ends."""
    with replacing(path) as temporary:
        temporary.write_text(text)


def write_json(path: Path, content: Any) -> None:
    """Writes a JSON file whole or not at all."""
    write_text(path, json.dumps(content, indent=1) + "\n")


def read_mapping(path: Path, fix: str) -> dict[str, Any]:
    """Reads a JSON or YAML file that holds a mapping.

    Args:
        path: the file, ending in .json or .yaml.
        fix: what to do when it cannot be read; ends the message.

    Raises:
        ValueError: the file is missing, cut, empty, or holds something else than a mapping.
    """
    try:
        content = json.loads(path.read_text()) if path.suffix == ".json" else yaml.safe_load(path.read_text())
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ValueError(f"{path} cannot be read ({_first_line(error)}): {fix}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path} cannot be read (a mapping is expected, it holds {type(content).__name__}): {fix}")
    return content


def read_typed(kind: type[T], path: Path, fix: str) -> T:
    """Reads a JSON or YAML file into a dataclass, its values checked.

    Args:
        kind: the dataclass.
        path: the file, ending in .json or .yaml.
        fix: what to do when it cannot be read; ends the message.

    Raises:
        ValueError: the file is missing, cut, empty, or holds something else.
    """
    content = read_mapping(path, fix)
    try:
        return TypeAdapter(kind).validate_python(content)
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()[:3])
        raise ValueError(f"{path} cannot be read ({faults}): {fix}") from error


def read_table(path: Path, columns: tuple[str, ...], fix: str) -> "pd.DataFrame":
    """Reads a CSV file that has at least one row and some columns.

    Args:
        path: the file.
        columns: columns that it must have.
        fix: what to do when it cannot be read; ends the message.

    Raises:
        ValueError: the file is missing, cut, empty, or lacks a column.
    """
    import pandas as pd  # slow to import, and recording does without

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} cannot be read ({_first_line(error)}): {fix}") from error
    missing = [name for name in columns if name not in table]
    if missing or table.empty or table[list(columns)].isna().any(axis=None):
        fault = f"it lacks {', '.join(missing)}" if missing else "it lacks values"
        raise ValueError(f"{path} cannot be read ({fault}): {fix}")
    return table


def sha256(path: Path) -> str:
    """Computes the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def lock(directory: Path, name: str = ".lock") -> Iterator[None]:
    """Keeps a second process waiting, and saying so, until the first has done its part in a directory.

    By flock; where a shared file system has none, by a file that only one process can create. Of such a file that a
    machine left when it went down, `waiting` names the directory: delete it there.

    Args:
        directory: which must exist.
        name: of the file that stands for the lock.
    """
    guard = FileLock(directory / name)
    try:
        guard.acquire(timeout=0)
    except Timeout:
        print(f"waiting: another process works in {directory}", flush=True)
        guard.acquire()
    try:
        yield
    finally:
        guard.release()


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0] or type(error).__name__
