import os
import sys
from types import SimpleNamespace

import joblib
import psutil
import pytest

from repro.runs import parallel
from repro.runs.parallel import parallel_trainings, process_pool, training_memory_gb, use_idle_cores


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
    monkeypatch.setattr(parallel, "count_cores", lambda: cores)
    monkeypatch.setattr(parallel, "available_memory_gb", lambda: memory_gb)
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
    ("size_px", "batch", "pairs", "channels", "measured_gb"),
    [
        (64, 8, 2000, 1, 1.31),  # U-Net, as those without a comment
        (64, 8, 2000, 1, 1.56),  # UPerNet
        (128, 8, 3000, 1, 1.54),
        (256, 8, 3000, 1, 2.65),
        (256, 16, 10_000, 1, 5.28),
        (64, 8, 2000, 200, 2.48),  # a network with a series of 100 parts
        (128, 2, 20_000, 20, 3.40),  # ConvGRU
    ],
)
def test_the_memory_of_a_training_is_estimated_within_a_third(size_px, batch, pairs, channels, measured_gb):
    assert 0.95 * measured_gb < training_memory_gb(size_px, batch, pairs, channels) < 1.35 * measured_gb


@pytest.mark.parametrize(
    ("idle", "logged", "threads"), [(True, "using 4 threads", None), (False, "using one thread", "1")]
)
def test_a_single_training_uses_several_threads_on_idle_cores_only(idle, logged, threads, monkeypatch, caplog):
    monkeypatch.setattr(parallel, "count_cores", lambda: 4)
    monkeypatch.setattr(parallel, "cores_are_idle", lambda: idle)
    loaded = SimpleNamespace(set_num_threads=lambda number: taken.append(number))
    monkeypatch.setitem(sys.modules, "torch", loaded)
    taken: list[int] = []
    monkeypatch.setattr(parallel, "use_threads", taken.append)
    caplog.set_level("INFO")
    use_idle_cores()
    assert logged in caplog.text
    assert os.environ.get("OMP_NUM_THREADS") == threads
    assert taken == 2 * [int(threads or 4)], "of compiled loops and of torch"
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)


@pytest.mark.parametrize(("used_percent", "idle"), [(20.0, True), (30.0, False), (60.0, False)])
def test_cores_are_idle_if_three_quarters_of_their_time_are_free(used_percent, idle, monkeypatch):
    monkeypatch.setattr(psutil, "cpu_percent", lambda _: used_percent)
    assert parallel.cores_are_idle() == idle


def test_threads_that_the_user_has_set_are_kept(monkeypatch, caplog):
    caplog.set_level("INFO")
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    use_idle_cores()
    parallel.use_one_thread()
    assert os.environ["OMP_NUM_THREADS"] == "3"
    assert caplog.text == ""
