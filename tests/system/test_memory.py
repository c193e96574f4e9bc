import os
import subprocess
import sys

import pytest

from repro.system import memory
from repro.system.memory import available_memory_gb, total_memory_gb


def test_the_limit_of_a_container_counts(monkeypatch, tmp_path):
    free = available_memory_gb()
    (tmp_path / "memory.max").write_text("3000000000\n")
    (tmp_path / "memory.current").write_text("2900000000\n")
    (tmp_path / "memory.stat").write_text("anon 1000000000\ninactive_file 1900000000\nactive_file 0\n")
    (tmp_path / "own").write_text("1:name=systemd:/\n0::/\n")
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    monkeypatch.setattr(memory, "OWN_GROUP", tmp_path / "own")
    assert available_memory_gb() == 2
    assert total_memory_gb() == 3
    job = tmp_path / "system.slice" / "job1"
    job.mkdir(parents=True)
    (job / "memory.max").write_text("1500000000\n")
    (job / "memory.current").write_text("600000000\n")
    (job / "memory.stat").write_text("inactive_file 100000000\n")
    (tmp_path / "own").write_text("0::/system.slice/job1\n")
    assert (available_memory_gb(), total_memory_gb()) == (1, 1.5)
    (job / "memory.max").write_text("max\n")
    assert (available_memory_gb(), total_memory_gb()) == (2, 3)
    (tmp_path / "own").write_text("0::/../outside\n")
    assert total_memory_gb() == 3
    (tmp_path / "own").unlink()
    (tmp_path / "memory.max").write_text("max\n")
    assert available_memory_gb() == pytest.approx(free, abs=2)
    assert total_memory_gb() >= available_memory_gb()


@pytest.mark.parametrize("keep", [False, True])
def test_kept_memory_is_reused_without_new_pages(keep):
    code = f"""
import resource
from repro.system.memory import keep_freed_memory
assert not {keep} or keep_freed_memory()
faults = []
for _ in range(20):
    first, second = bytearray(2**26), bytearray(2**26)
    del first, second
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
print(faults[-1] - faults[9])
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    pages = 10 * 2 * 2**26 // os.sysconf("SC_PAGE_SIZE")
    assert int(found.stdout) < 0.01 * pages if keep else int(found.stdout) > 0.5 * pages
