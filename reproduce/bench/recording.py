"""Benchmark recording against the plain IR-SIM loop on one core, and two workers against one."""

import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from table import head, row

from repro.simulation import behaviors  # noqa: F401  registers the behaviors
from repro.simulation.recorder import record_experiment
from repro.simulation.sampling import reverse_direction, sample_world, write_world
from repro.simulation.simulator import simulate
from repro.worlds.spec import WorldSpec, read_world, world_spec

ROOT = Path(__file__).parents[2]
PAPER_RUNS = 4 * (10_000 + 128 + 500)


def world_of(experiment: str) -> WorldSpec:
    """Return the description of the worlds of one of the paper's experiments."""
    return world_spec(read_world(ROOT / "conf" / "world" / "paper.yaml"), experiment)


def plain_loop(path: Path) -> np.ndarray:
    """Run the straightforward IR-SIM loop: create, step 100 times, copy each scan; ranges [m], (T, N)."""
    import irsim

    env = irsim.make(str(path), headless=True, log_level="ERROR")
    ranges = []
    for _ in range(100):
        env.step()
        ranges.append(env.robot.get_lidar_scan()["ranges"].copy())
    return np.array(ranges)


def bench_recording() -> None:
    """Compare one core with the plain loop, and two workers with one."""
    with tempfile.TemporaryDirectory() as folder:
        _one_core(Path(folder))
        _workers(Path(folder))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print(f"\nPeak memory of a worker: {peak:.2f} GB")


def _one_core(folder: Path, worlds: int = 12) -> None:
    head("Recording, one core", "experiment", "plain [ms/run]", "ours [ms/run]", "ratio", "largest difference [m]")
    for experiment in "1234":
        items = [sample_world(world_of(experiment), seed) for seed in range(worlds)]
        items += [reverse_direction(item) for item in items]
        ours = plain = difference = 0.0
        for item in items:
            write_world(item, folder / "world.yaml")
            began = time.perf_counter()
            expected = plain_loop(folder / "world.yaml")
            middle = time.perf_counter()
            scans = simulate(item).scans
            ours, plain = ours + time.perf_counter() - middle, plain + middle - began
            difference = max(difference, np.abs(np.minimum(scans.ranges, 30.0) - expected).max())
        times = [f"{1000 * seconds / len(items):.1f}" for seconds in (plain, ours)]
        row(experiment, *times, f"{plain / ours:.1f} x", f"{difference:.1e}")


def _workers(folder: Path, runs: int = 1200, rounds: int = 2) -> None:
    """Alternate one and two workers, so that other load on the machine affects both; keep the fastest round of each."""
    rates = {1: 0.0, 2: 0.0}
    for turn in range(rounds):
        for workers in rates:
            warm_up = folder / f"warm{workers}-{turn}"  # so that every worker has imported IR-SIM
            record_experiment(warm_up, world_of("4"), {"train": 400}, workers=workers)
            began = time.perf_counter()
            record_experiment(folder / f"{workers}-{turn}", world_of("4"), {"train": runs}, workers=workers)
            rates[workers] = max(rates[workers], runs / (time.perf_counter() - began))
    size = sum(path.stat().st_size for path in (folder / "1-0").glob("*.npz")) / runs * PAPER_RUNS / 1e9
    title = f"Recording to disk (experiment 4, {runs:,} runs)"
    head(title, "workers", "runs/s", "ratio", f"all {PAPER_RUNS:,} runs", "disk")
    for workers, rate in rates.items():
        minutes = f"{PAPER_RUNS / rate / 60:.1f} min"
        row(str(workers), f"{rate:.0f}", f"{rate / rates[1]:.2f} x", minutes, f"{size:.2f} GB")
