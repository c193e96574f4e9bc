"""Speed and memory as ratios to the plain way, all measured in this one run on this machine.

make bench        or        python reproduce/bench.py [recording projection training]
"""

import argparse
import resource
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from bench_training import TRAINING_COLUMNS, device_name, training_rows

from repro.config import read_world, world_spec
from repro.simulation import behaviors  # noqa: F401  registers them

ROOT = Path(__file__).parents[1]

PAPER_RUNS = 4 * (10_000 + 128 + 500)


def spec(experiment: str) -> dict[str, Any]:
    return world_spec(read_world(ROOT / "conf" / "world" / "paper.yaml"), experiment)


def row(name: str, *cells: str) -> None:
    print("| " + " | ".join((name, *cells)) + " |", flush=True)


def heads(title: str, *names: str) -> None:
    print(f"\n### {title}\n", flush=True)
    row(*names)
    print("|" + "---|" * len(names))


def plain_loop(path: Path) -> np.ndarray:
    """The straightforward IR-SIM loop: make, 100 times step, copy the scan."""
    import irsim

    env = irsim.make(str(path), headless=True, log_level="ERROR")
    ranges = []
    for _ in range(100):
        env.step()
        ranges.append(env.robot.get_lidar_scan()["ranges"].copy())
    return np.array(ranges)


def bench_recording(worlds: int = 12) -> None:
    """One core against the plain loop, two workers against one, and what paper scale costs."""
    from repro.simulation.recording import simulate
    from repro.simulation.store import record_experiment
    from repro.simulation.worlds import sample_world, turn_around, write_world

    heads("Recording, one core", "experiment", "plain [ms/run]", "ours [ms/run]", "ratio", "largest difference [m]")
    with tempfile.TemporaryDirectory() as folder:
        for experiment in "1234":
            items = [sample_world(spec(experiment), seed) for seed in range(worlds)]
            items += [turn_around(item) for item in items]
            paths = [Path(folder) / f"{k}.yaml" for k in range(len(items))]
            for item, path in zip(items, paths, strict=True):
                write_world(item, path)
            scans, truths = [], []
            ours = plain = 0.0
            for item, path in zip(items, paths, strict=True):
                began = time.perf_counter()
                truths.append(plain_loop(path))
                middle = time.perf_counter()
                scans.append(simulate(item).scans.ranges)
                ours, plain = ours + time.perf_counter() - middle, plain + middle - began
            apart = np.abs(np.minimum(scans, 30.0) - np.array(truths)).max()
            times = [f"{1000 * seconds / len(items):.1f}" for seconds in (plain, ours)]
            row(experiment, *times, f"{plain / ours:.1f} x", f"{apart:.1e}")

        heads("Recording to disk (experiment 4, 1,200 runs)", "workers", "runs/s", "ratio", "all 42,512 runs", "disk")
        rates = {}
        for workers in (1, 2):
            directory = Path(folder) / f"workers{workers}"
            warm_up = {"train": 400}  # every worker has imported IR-SIM before the clock starts
            record_experiment(Path(folder) / f"warm{workers}", spec("4"), warm_up, workers=workers)
            began = time.perf_counter()
            record_experiment(directory, spec("4"), {"train": 1200}, workers=workers)
            rates[workers] = 1200 / (time.perf_counter() - began)
            size = sum(path.stat().st_size for path in directory.glob("*.npz")) / 1200 * PAPER_RUNS / 1e9
            minutes = PAPER_RUNS / rates[workers] / 60
            row(
                str(workers), f"{rates[workers]:.0f}", f"{rates[workers] / rates[1]:.2f} x",
                f"{minutes:.1f} min", f"{size:.2f} GB",
            )  # fmt: skip
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print(f"\nPeak memory of a worker: {peak:.2f} GB")


def bench_projection(runs: int = 10_000) -> None:
    """10,000 runs to 256 px, against one point at a time."""
    from repro.maps.grid import Grid
    from repro.maps.projection import Projection
    from repro.scans import Scans
    from repro.simulation.recording import simulate
    from repro.simulation.worlds import sample_world

    scans = Scans.stack([simulate(sample_world(spec("4"), seed)).scans for seed in range(100)])
    windows, encoding, grid = scans.tensors(), Projection(), Grid(256, 50.0)
    began = time.perf_counter()
    for _ in range(runs // 100):
        images = encoding.encode(windows, grid)
    ours = time.perf_counter() - began
    began = time.perf_counter()
    slow = plain_projection(scans.ranges[0], scans.angles, scans.poses[0], 256)
    plain = time.perf_counter() - began
    differ = np.count_nonzero(np.abs(slow - images[0, 0].numpy().astype(int)) > 1)
    heads("Projection to 256 x 256", "way", "10,000 runs", "ratio", "peak memory of this process")
    row("one point at a time", f"{plain * runs:.0f} s", "1 x", "")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    row("ours", f"{ours:.1f} s", f"{plain * runs / ours:.0f} x", f"{peak:.2f} GB")
    print(f"\nPixels that differ in the first run: {differ} (float32 against float64)")


def plain_projection(ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray, size_px: int) -> np.ndarray:
    image = np.full((size_px, size_px), 255)
    for step, (x, y, heading) in enumerate(poses):
        for distance, angle in zip(ranges[step], angles, strict=True):
            if np.isfinite(distance):
                column = int(np.floor((x + distance * np.cos(heading + angle)) / 50 * size_px))
                row_px = size_px - 1 - int(np.floor((y + distance * np.sin(heading + angle)) / 50 * size_px))
                if 0 <= row_px < size_px and 0 <= column < size_px:
                    image[row_px, column] = round(255 * 0.8 * (1 - step / 99))
    return image


def bench_training(size_px: int, batch_size: int, pairs: int, with_compile: bool) -> None:
    """An epoch of ours against the plain one, in every precision this machine computes in natively."""
    heads(f"Training at {size_px} px, batch {batch_size}, {device_name()}", *TRAINING_COLUMNS)
    for cells in training_rows(size_px, batch_size, pairs, with_compile):
        row(*cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["recording", "projection", "training"])
    parser.add_argument("--size-px", type=int, default=256 if torch.cuda.is_available() else 64)
    parser.add_argument("--batch-size", type=int, default=16 if torch.cuda.is_available() else 8)
    parser.add_argument("--pairs", type=int, default=2048 if torch.cuda.is_available() else 160)
    parser.add_argument("--compile", action="store_true", help="a row for torch.compile, which takes minutes")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if "recording" in options.parts:
        bench_recording()
    if "projection" in options.parts:
        bench_projection()
    if "training" in options.parts:
        bench_training(options.size_px, options.batch_size, options.pairs, options.compile)


if __name__ == "__main__":
    main()
