"""Processes, threads and trainings that run at the same time, without importing torch."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil

from repro.system.memory import available_memory_gb
from repro.system.threads import use_threads

log = logging.getLogger(__name__)
LEAST_IDLE = 0.75  # share of the time of all cores that must be free for them to count as idle
THREADS = "OMP_NUM_THREADS"


def count_cores() -> int:
    """Return the number of cores that this process may use, by affinity and by the limits of a container."""
    import joblib

    return joblib.cpu_count()


def cores_are_idle() -> bool:
    """Return whether at least three quarters of the time of all cores are free, measured over 0.3 s."""
    return psutil.cpu_percent(0.3) <= 100 * (1 - LEAST_IDLE)


@contextmanager
def process_pool(workers: int, **options: Any) -> Iterator[Any]:
    """Create a pool of processes that ends with the context.

    joblib keeps the processes of a pool for five minutes. A process of a sweep whose pool is kept cannot end before
    that, and the sweep waits for it.

    Args:
        workers: number of processes; with 1, the work is done in this process.
        options: further options of `joblib.Parallel`.
    """
    import joblib  # these need the study
    from joblib.externals.loky import get_reusable_executor

    try:
        yield joblib.Parallel(n_jobs=workers, backend="loky", **options)
    finally:
        if workers > 1:
            get_reusable_executor().shutdown(wait=True, kill_workers=True)


def use_one_thread() -> None:
    """Make the jobs of this process and its workers compute on one thread each, unless the user has set the threads.

    The threads of a training wait for one another. Beside other processes on the same cores it takes many times as long
    with two threads as with one.
    """
    os.environ.setdefault(THREADS, "1")
    if os.environ[THREADS] == "1":
        use_threads(1)
    if "torch" in sys.modules and os.environ[THREADS] == "1":
        sys.modules["torch"].set_num_threads(1)


@cache
def use_idle_cores() -> None:
    """Use all cores if they are idle, else one, unless the user or the sweep has set the threads; log which."""
    if THREADS in os.environ:
        return
    if count_cores() > 1 and cores_are_idle():
        log.info("using %d threads, since the cores are idle; %s=1 uses one", count_cores(), THREADS)
        use_threads(count_cores())
        if "torch" in sys.modules:  # which takes the cores of the machine, not those of a container
            sys.modules["torch"].set_num_threads(count_cores())
    elif count_cores() > 1:
        log.info("using one thread, since the cores are busy; %s sets another number", THREADS)
        use_one_thread()


def training_memory_gb(size_px: int, batch_size: int, pairs: int, channels: int = 1) -> float:
    """Estimate the memory of one training on a CPU [GB], from above.

    The libraries and the scans that are being drawn take 1.45 GB, the images a byte per pixel, those of a series a bit,
    and 45 % more, and the activations of a batch the size of 600 float32 images per image, or of 60 per channel: a
    recurrent network has them for every part of the window. Measured trainings took from a quarter less to 5 % more.

    Args:
        size_px: pixels along one side.
        batch_size: images per batch.
        pairs: pairs in memory, those of training and validation.
        channels: channels of the encoding; more than two are those of a series.
    """
    images = channels if channels <= 2 else channels / 8
    activations = 4 * 60 * max(10, channels) * batch_size
    return 1.45 + size_px**2 * (1.45 * (images + 1) * pairs + activations) / 1e9


def parallel_trainings(size_px: int, batch_size: int, pairs: int, channels: int = 1) -> int:
    """Return how many trainings run at the same time: one per core, as many as the memory can hold, at least one."""
    fitting = int(available_memory_gb() / training_memory_gb(size_px, batch_size, pairs, channels))
    return max(1, min(count_cores(), fitting))


def has_gpu() -> bool:
    """Return whether a CUDA GPU is visible, without importing torch where there is no driver."""
    if sys.platform == "linux" and not any(Path(path).exists() for path in ("/dev/nvidiactl", "/dev/dxg")):
        return False
    if find_spec("torch") is None:
        return False
    import torch

    return torch.cuda.is_available()
