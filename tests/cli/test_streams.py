"""Standard streams that are closed, full or no longer read."""

import os
import subprocess
import sys

import pytest
from conftest import ROOT, TINY

pytestmark = pytest.mark.slow


def shell(script: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a script of bash in which `$RUN` is run.py."""
    env = os.environ | {"RUN": f"{sys.executable} run.py"} | environment
    return subprocess.run(["bash", "-c", script], cwd=ROOT, env=env, capture_output=True, text=True, timeout=300)


def test_a_training_needs_no_standard_streams(tmp_path):
    done = shell(f"$RUN {' '.join(TINY)} exp=3 outputs={tmp_path}/first <&- >&- 2>&-")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "first/runs/exp3/unet/projection/seed0/metrics.csv").is_file()


def test_a_reader_that_goes_away_stops_the_call_with_one_line(tmp_path):
    done = shell(f"$RUN -m exp=3,4 {' '.join(TINY)} outputs={tmp_path}/first | head -1; exit ${{PIPESTATUS[0]}}")
    assert done.returncode == 1
    assert "stopped; the same command resumes" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_limit_on_the_size_of_files_is_named(tmp_path):
    done = shell(f"ulimit -f 100; $RUN {' '.join(TINY)} exp=3 outputs={tmp_path}/first")
    assert done.returncode == 1
    assert "ulimit -f" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_name_that_the_terminal_cannot_show_is_printed_with_escapes(tmp_path):
    ascii_only = {"PYTHONIOENCODING": "ascii"}
    done = shell(f"$RUN task=world exp=3 'outputs=\"{tmp_path}/Ä\"'", **ascii_only)
    assert done.returncode == 0, done.stderr
    assert "\\xc4" in done.stdout
    assert (tmp_path / "Ä/worlds").is_dir()
