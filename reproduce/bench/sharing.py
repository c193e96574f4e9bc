"""Benchmark training under CPU contention: the slowdown, and the part explained by its share of the cores."""

import os
import subprocess
import sys

from table import head, row

STEPS = """
import time
from training import our_epoch
from repro.system.devices import resolve_precision
epoch = our_epoch("unet", 64, 8, 32, "cpu", resolve_precision("auto", "cpu"))
epoch()
until, times = time.monotonic() + 8, []
while time.monotonic() < until:
    times.append(epoch()[0])
print(sum(times) / len(times) / 32)
"""


def bench_sharing() -> None:
    """Time U-Net at 64 px with 1 thread and 1 thread per core, alone and beside 1 busy process per core."""
    cores = os.cpu_count() or 1
    title = f"A training beside {cores} busy processes on {cores} cores (U-Net, 64 px)"
    head(title, "threads", "alone [ms/image]", "beside [ms/image]", "slower by", "its share explains")
    for threads in sorted({1, cores}):
        alone = _ms_per_image(threads)
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(cores)]
        try:
            beside = _ms_per_image(threads)
        finally:
            for process in busy:
                process.kill()
                process.wait()
        explained = (cores + threads) / cores
        row(str(threads), f"{alone:.1f}", f"{beside:.1f}", f"{beside / alone:.1f} x", f"{explained:.1f} x")


def _ms_per_image(threads: int) -> float:
    command = [sys.executable, "-W", "ignore", "-c", STEPS]
    env = os.environ | {"OMP_NUM_THREADS": str(threads), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    finished = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
    return 1000 * float(finished.stdout.split()[-1])
