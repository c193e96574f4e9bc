"""Small files: atomic writes, reads whose errors name the file and the fix, locks and checksums."""

import hashlib
import json
import logging
import os
import re
import shutil
import stat
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import yaml
from filelock import FileLock, Timeout
from pydantic import TypeAdapter, ValidationError

from repro.system.errors import InputError

log = logging.getLogger(__name__)
T = TypeVar("T")
MAX_BYTES, MAX_VALUES = 2**26, 1_000_000  # of a small file
LEFTOVER = re.compile(r"(.+)\.[0-9a-f]{32}(\.old)?\.tmp")  # temporary names that this module creates


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write to, and move it to `path` when the block ends without an error.

    The temporary name is unique, so several processes may replace the same file; the last one wins.

    Args:
        path: the file to create or replace; its directory must exist.
    """
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error  # not every writer names the file
    finally:
        with suppress(OSError):  # the disk may be gone
            temporary.unlink(missing_ok=True)


@contextmanager
def replacing_directory(path: Path, own: Callable[[str], object] | None = None) -> Iterator[Path]:
    """Yield an empty directory beside `path` to fill, and move it to `path` when the block ends without an error.

    A directory at `path` is moved aside first and deleted last, so that an error leaves the old or the new one. Where
    the process is killed in between, `clear_leftovers` moves the old one back.

    Args:
        path: the directory to create or replace.
        own: tells by the name of a file whether it may be replaced; None for all. Others raise an `InputError`, as does
            a file at `path`.
    """
    path = Path(os.path.realpath(path)) if path.is_symlink() else path  # a link stays one
    others = [path] if path.exists() and not path.is_dir() else path.glob("*")
    foreign = [path.name for path in others if own and not (path.is_file() and own(path.name))]
    if foreign:
        raise InputError(f"{path} is replaced as a whole and has files such as {min(foreign)}: move them elsewhere")
    new, old = (path.with_name(f"{path.name}.{uuid.uuid4().hex}{kind}.tmp") for kind in ("", ".old"))
    new.mkdir(parents=True)
    try:
        yield new
        if path.exists():
            os.replace(path, old)
        os.replace(new, path)
    except BaseException as error:
        if old.exists() and not path.exists():
            os.replace(old, path)
        if isinstance(error, OSError) and error.errno:
            error.filename = error.filename or str(path)  # not every writer names the file
        raise
    finally:
        shutil.rmtree(new, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def clear_leftovers(directory: Path, keep: Path | None = None, of: str | None = None) -> None:
    """Delete the temporary files that killed processes left in a directory.

    A directory that was moved aside by `replacing_directory` is moved back if nothing is in its place. No other process
    may be using the directory. Only names that this module creates are deleted.

    Args:
        directory: the directory, which the caller has locked.
        keep: a temporary file that the caller itself is writing.
        of: name of the only file or directory whose temporary files are deleted, which the caller has locked; None
            for all.
    """
    for leftover in directory.glob("*.tmp"):
        match = LEFTOVER.fullmatch(leftover.name)
        if leftover == keep or not match or of not in (None, match[1]):
            continue
        target = leftover.with_name(match[1])
        if match[2] and not target.exists():
            os.replace(leftover, target)
        elif leftover.is_dir() and not leftover.is_symlink():
            shutil.rmtree(leftover)
        else:
            leftover.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, even if the process is killed."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file atomically."""
    write_text(path, json.dumps(content, indent=1) + "\n")


def check_regular(path: Path) -> None:
    """Check that a path is a file with an end: reading a pipe would wait, and reading a device might fill the memory.

    Raises:
        InputError: it is something else.
        OSError: it is missing.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise InputError("expected a regular file")


def read_mapping(path: Path, fix: str) -> dict[str, Any]:
    """Read a JSON or YAML file that holds a mapping.

    Args:
        path: the file, ending in .json or .yaml.
        fix: what to do if the file cannot be read; appended to the message.

    Raises:
        InputError: the file is missing, truncated, empty, nested too deeply, or does not hold a mapping.
    """
    try:
        check_regular(path)
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"it has {path.stat().st_size:,} bytes, expected at most {MAX_BYTES:,}")
        content = (
            json.loads(path.read_text(encoding="utf-8"))
            if path.suffix == ".json"
            else yaml.safe_load(path.read_text(encoding="utf-8"))
        )
        if path.suffix != ".json":
            check_size(content)
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        problem = "it is nested too deeply" if isinstance(error, RecursionError) else first_line(error)
        raise InputError(f"{path} cannot be read ({problem}): {fix}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path} cannot be read (expected a mapping, got {type(content).__name__}): {fix}")
    return content


def check_size(content: Any, most: int = MAX_VALUES) -> None:
    """Refuse what aliases of YAML make of a few bytes: the values that it would have without them are counted.

    Raises:
        InputError: there are more than `most`.
    """
    sizes: dict[int, int] = {}

    def size_of(value: Any) -> int:
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        if id(value) not in sizes or not parts:
            sizes[id(value)] = MAX_VALUES  # of one that contains itself
            sizes[id(value)] = 1 + sum(map(size_of, parts))
        return sizes[id(value)]

    if (size := size_of(content)) > most:
        raise InputError(f"its aliases stand for {size:,} values, expected at most {most:,}")


def read_typed(kind: type[T], path: Path, fix: str) -> T:
    """Read a JSON or YAML file into a dataclass and check its values.

    Args:
        kind: the dataclass.
        path: the file, ending in .json or .yaml.
        fix: what to do if the file cannot be read; appended to the message.

    Raises:
        InputError: the file is missing, truncated, empty, or does not match the dataclass.
    """
    content = read_mapping(path, fix)
    try:
        return TypeAdapter(kind).validate_python(content)
    except ValidationError as error:
        errors = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()[:3])
        raise InputError(f"{path} cannot be read ({errors}): {fix}") from error


def sha256(path: Path) -> str:
    """Compute the SHA-256 checksum of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def lock(directory: Path, name: str = ".lock") -> Iterator[None]:
    """Hold an exclusive lock on a directory; a second process logs a message and waits.

    The lock uses flock, or on a shared file system without flock a file that only one process can create. If a machine
    crashed and left such a file, every later process waits: delete the file in the directory that the message names.

    Args:
        directory: the directory, which must exist.
        name: name of the lock file.
    """
    guard = FileLock(directory / name)
    try:
        guard.acquire(timeout=0)
    except Timeout:
        log.info("waiting: another process is working in %s", directory)
        guard.acquire()
    try:
        yield
    finally:
        guard.release()


def first_line(error: Exception) -> str:
    """Return the first line of the message of an error, without its number and file, or its type if it has none."""
    return str(getattr(error, "strerror", None) or error).strip().split("\n")[0] or type(error).__name__
