import os
import subprocess
import sys
from types import SimpleNamespace

import joblib
import psutil
import pytest

from repro.system import resources
from repro.system.resources import (
    available_memory_gb,
    parallel_trainings,
    process_pool,
    total_memory_gb,
    training_memory_gb,
    use_idle_cores,
)


@pytest.fixture(autouse=True)
def not_decided(monkeypatch):
    use_idle_cores.cache_clear()
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    yield
    use_idle_cores.cache_clear()


@pytest.mark.parametrize(
    ("cores", "memory_gb", "trainings"), [(1, 100.0, 1), (2, 100.0, 2), (16, 100.0, 16), (16, 6.5, 4), (16, 0.1, 1)]
)
def test_one_training_per_core_as_many_as_the_memory_can_hold(cores, memory_gb, trainings, monkeypatch):
    monkeypatch.setattr(resources, "count_cores", lambda: cores)
    monkeypatch.setattr(resources, "available_memory_gb", lambda: memory_gb)
    assert parallel_trainings(64, 8, 2000) == trainings


@pytest.mark.parametrize("fails", [False, True])
def test_the_processes_of_a_pool_end_with_it(fails):
    jobs = [joblib.delayed(os.getpid)() for _ in range(8)]
    try:
        with process_pool(2) as parallel:
            ids = set(parallel(jobs))
            assert os.getpid() not in ids
            assert all(psutil.pid_exists(number) for number in ids)
            if fails:
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        assert fails
    assert not any(psutil.pid_exists(number) for number in ids)


@pytest.mark.parametrize(
    ("size_px", "batch", "pairs", "channels", "loss", "measured_gb"),
    [
        (64, 8, 2000, 1, "map", 1.31),  # U-Net, as those without a comment
        (64, 8, 2000, 1, "map", 1.56),  # UPerNet
        (128, 8, 3000, 1, "map", 1.54),
        (256, 8, 3000, 1, "map", 2.65),
        (256, 16, 10_000, 1, "map", 5.28),
        (64, 8, 2000, 200, "map", 2.48),  # DeepTracking
        (128, 2, 20_000, 20, "map", 3.40),  # ConvGRU
        (64, 8, 2000, 20, "visible", 1.81),  # DeepTracking
        (64, 8, 2000, 200, "visible", 6.68),
        (64, 8, 2000, 200, "visible", 8.64),
    ],
)
def test_the_memory_of_a_training_is_estimated_within_a_third(size_px, batch, pairs, channels, loss, measured_gb):
    assert 0.95 * measured_gb < training_memory_gb(size_px, batch, pairs, channels, loss) < 1.35 * measured_gb


def test_the_limit_of_a_container_counts(monkeypatch, tmp_path):
    free = available_memory_gb()
    (tmp_path / "memory.max").write_text("3000000000\n")
    (tmp_path / "memory.current").write_text("2900000000\n")
    (tmp_path / "memory.stat").write_text("anon 1000000000\ninactive_file 1900000000\nactive_file 0\n")
    (tmp_path / "own").write_text("1:name=systemd:/\n0::/\n")
    monkeypatch.setattr(resources, "CGROUP", tmp_path)
    monkeypatch.setattr(resources, "OWN_GROUP", tmp_path / "own")
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


@pytest.mark.parametrize(
    ("idle", "printed", "threads"), [(True, "using 4 threads", None), (False, "using one thread", "1")]
)
def test_a_single_training_uses_several_threads_on_idle_cores_only(idle, printed, threads, monkeypatch, capsys):
    monkeypatch.setattr(resources, "count_cores", lambda: 4)
    monkeypatch.setattr(resources, "cores_are_idle", lambda: idle)
    loaded = SimpleNamespace(set_num_threads=lambda number: taken.append(number))
    monkeypatch.setitem(sys.modules, "torch", loaded)
    taken: list[int] = []
    use_idle_cores()
    assert printed in capsys.readouterr().out
    assert os.environ.get("OMP_NUM_THREADS") == threads
    assert taken == [int(threads or 4)]
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)


def test_threads_that_the_user_has_set_are_kept(monkeypatch, capsys):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    use_idle_cores()
    resources.use_one_thread()
    assert os.environ["OMP_NUM_THREADS"] == "3"
    assert capsys.readouterr().out == ""


def test_resources_do_not_import_torch():
    code = "import sys, repro.system.resources; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("keep", [False, True])
def test_kept_memory_is_reused_without_new_pages(keep):
    code = f"""
import resource
from repro.system.resources import keep_freed_memory
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
