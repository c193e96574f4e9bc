import errno
import fcntl
import multiprocessing
import subprocess
import sys
import time
from pathlib import Path

import pytest

from repro.runs.directories import read_table
from repro.system.files import clear_leftovers, lock, read_mapping, replacing, replacing_directory, write_text


def _write_often(path: Path, word: str, errors) -> None:
    try:
        for _ in range(50):
            write_text(path, word * 1000)
    except OSError as error:
        errors.put(str(error))


def test_processes_that_replace_one_file_do_not_collide(tmp_path):
    context = multiprocessing.get_context("spawn")
    errors = context.Queue()
    processes = [context.Process(target=_write_often, args=(tmp_path / "file", word, errors)) for word in "abcd"]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert errors.empty()
    assert (tmp_path / "file").read_text() in {word * 1000 for word in "abcd"}
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_failed_write_leaves_the_previous_file(tmp_path):
    write_text(tmp_path / "file", "whole")

    def write_half():
        with replacing(tmp_path / "file") as temporary:
            temporary.write_text("ha")
            raise OSError("disk full")

    with pytest.raises(OSError, match="full"):
        write_half()
    assert (tmp_path / "file").read_text() == "whole"
    assert len(list(tmp_path.iterdir())) == 1


def test_an_error_of_a_full_disk_names_the_directory(tmp_path):
    with pytest.raises(OSError, match="full") as raised, replacing_directory(tmp_path / "results"):
        raise OSError(errno.ENOSPC, "full")
    assert raised.value.filename == str(tmp_path / "results")
    assert not list(tmp_path.iterdir())


def test_a_directory_that_was_being_replaced_is_moved_back(tmp_path):
    """The process is killed between the two moves: nothing has the name of the directory."""
    target = tmp_path / "results"
    target.mkdir()
    (target / "old").touch()
    code = f"""
import os
from pathlib import Path
from repro.system import files
replace = os.replace
def replace_once(*paths):
    replace(*paths)
    os._exit(9)
os.replace = replace_once
with files.replacing_directory(Path({str(target)!r})) as new:
    (new / "new").touch()
"""
    assert subprocess.run([sys.executable, "-c", code]).returncode == 9
    assert not target.exists()
    clear_leftovers(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["results"]
    assert [path.name for path in target.iterdir()] == ["old"]


def test_a_directory_that_was_replaced_is_deleted(tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / f"results.{'0' * 32}.old.tmp").mkdir()
    (tmp_path / f"results.{'1' * 32}.tmp").mkdir()
    clear_leftovers(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["results"]


def _count_under_lock(directory: Path, without_flock: bool) -> None:
    if without_flock:

        def refuse(*_):
            raise OSError(errno.ENOSYS, "Function not implemented")

        fcntl.flock = refuse
    for _ in range(20):
        with lock(directory):
            count = int((directory / "count").read_text())
            time.sleep(0.001)
            (directory / "count").write_text(str(count + 1))


@pytest.mark.parametrize("without_flock", [False, True])
def test_a_lock_lets_in_one_process_at_a_time_with_and_without_flock(tmp_path, without_flock):
    (tmp_path / "count").write_text("0")
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_count_under_lock, args=(tmp_path, without_flock)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert (tmp_path / "count").read_text() == "60"


WRONG = dict.fromkeys(("a.json", "a.yaml"), (None, "", "[1]", "{", "7", "\x00"))
WRONG["t.csv"] = (None, "", "a,b\n", "a,c\n1,2\n", "a,b\n1\n")


@pytest.mark.parametrize(("name", "content"), [(name, text) for name, contents in WRONG.items() for text in contents])
def test_an_unreadable_mapping_or_table_is_named_with_a_fix(tmp_path, name, content):
    if content is not None:
        (tmp_path / name).write_text(content)
    read = (lambda path, fix: read_table(path, ("a", "b"), fix)) if name == "t.csv" else read_mapping
    with pytest.raises(ValueError, match=rf"{name} cannot be read \((?!\[Errno).*\): do this"):
        read(tmp_path / name, "do this")
