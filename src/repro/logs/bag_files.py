"""Files of bags, checked before rosbags opens them: what it would lose, misread, or wait for."""

import re
from pathlib import Path
from typing import Any, BinaryIO

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap

from repro.system.errors import InputError
from repro.system.files import check_regular

SUFFIXES = (".bag", ".db3", ".mcap")
METADATA, MAX_METADATA = "metadata.yaml", 2**22  # [bytes], of thousands of topics
ALIAS = re.compile(rb"(?:^|[\s\[{,:-])[&*][A-Za-z0-9]")  # of YAML, of which few bytes become gigabytes
PROFILE_START = 21  # of its name in an MCAP, after its magic and the head of its first record [bytes]
PAGE_SIZE = slice(16, 18)  # of the number in the head of a database
REPAIR = "repair it, such as with rosbag reindex, ros2 bag reindex or mcap recover"


def check_files(path: Path) -> None:
    """Check the files of a bag, and that rosbags takes its name.

    Raises:
        InputError: a file is missing, is none with an end, or has another content than rosbags takes.
    """
    if path.is_dir() and not (path / METADATA).exists():
        raise InputError(f"{path}: is a directory without metadata.yaml, as that of a bag of ROS 2: name a file in it")
    if path.is_file() and path.suffix not in SUFFIXES:
        raise InputError(f"{path}: is a bag: expected a name that ends with {', '.join(SUFFIXES)}")
    for file in path.iterdir() if path.is_dir() else [path]:
        if file.suffix in SUFFIXES or file.name == METADATA:
            try:
                check_regular(file)
            except InputError as error:
                raise InputError(f"{file}: {error}") from error
            (_check_metadata if file.name == METADATA else _check)(file)


def _check_metadata(path: Path) -> None:
    with path.open("rb") as file:
        content = file.read(MAX_METADATA + 1)
    if len(content) > MAX_METADATA or ALIAS.search(content):
        problem = "aliases" if len(content) <= MAX_METADATA else f"more than {MAX_METADATA:,} bytes"
        raise InputError(f"{path}: has {problem}, which that of a bag has not: {REPAIR}")


def _check(path: Path) -> None:
    """Refuse files of which rosbags would lose or misread messages: a database that was not closed, MCAP of ROS 1."""
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size:
        raise InputError(
            f"{path}: its last messages are in {log.name}, as of a recorder that was killed: move them into it with "
            f"sqlite3 {path} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    with path.open("rb") as file:
        head = file.read(PROFILE_START + 100)
    if head.startswith(b"SQLite ") and path.stat().st_size % int.from_bytes(head[PAGE_SIZE] or b"\1", "big"):
        raise InputError(f"{path}: the bag is truncated: {REPAIR}")
    if head.startswith(b"\x89MCAP0\r") and len(head) > PROFILE_START:
        length = int.from_bytes(head[PROFILE_START - 4 : PROFILE_START], "little")
        profile = head[PROFILE_START:][:length].decode(errors="replace")
        if profile not in ("ros2", ""):
            ros1 = ": give the .bag of ROS 1 that it was made from, or convert that with rosbags-convert"
            raise InputError(
                f"{path}: expected an MCAP with messages of ROS 2, got the profile {profile!r}"
                f"{ros1 if profile == 'ros1' else ''}"
            )


_read_string, _definition_of = storage_mcap.read_string, storage_mcap.get_msgdef


def _read_profile(stream: BinaryIO) -> str:
    """Read a text of an MCAP; no profile, the first text of its first record, becomes that of ROS 2."""
    is_head = stream.tell() == 0
    return _read_string(stream) or ("ros2" if is_head else "")


def _definition(schema: Any) -> MessageDefinition:
    """Return the definition of a message; that of a channel that is none of ROS is empty, and nobody reads it."""
    is_ros = schema is None or schema.encoding in ("ros2msg", "ros2idl", "omgidl", "")
    return _definition_of(schema) if is_ros else MessageDefinition(MessageDefinitionFormat.NONE, "")


vars(storage_mcap).update(read_string=_read_profile, get_msgdef=_definition)  # rosbags refuses such files as a whole
