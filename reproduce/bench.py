"""Speed and memory as ratios to the plain way, all measured in this one run on this machine.

make bench        or        python reproduce/bench.py [recording projection training]
"""

import argparse
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from torch.utils.data import DataLoader, TensorDataset
from torch.utils.flop_counter import FlopCounterMode

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import run as entry  # noqa: E402

from repro.behaviors import Drift  # noqa: E402, F401  registers the behaviours

PAPER_RUNS = 4 * (10_000 + 128 + 500)


def spec(experiment: str) -> dict[str, Any]:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return entry.world_spec(compose("config", overrides=[f"exp={experiment}"]))


def clock(work: Callable[[], Any], repeat: int = 3) -> float:
    """Median time of some calls [s]."""
    times = []
    for _ in range(repeat):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


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
    from repro.recording import record
    from repro.store import record_experiment
    from repro.worlds import sample_world, turn_around, write_world

    heads("Recording, one core", "experiment", "plain [ms/run]", "ours [ms/run]", "ratio", "largest difference [m]")
    with tempfile.TemporaryDirectory() as folder:
        for experiment in "1234":
            items = [sample_world(spec(experiment), seed) for seed in range(worlds)]
            items += [turn_around(item) for item in items]
            paths = [Path(folder) / f"{k}.yaml" for k in range(len(items))]
            for item, path in zip(items, paths, strict=True):
                write_world(item, path)
            scans, truths, ours, plain = [], [], 0.0, 0.0
            for item, path in zip(items, paths, strict=True):
                began = time.perf_counter()
                truths.append(plain_loop(path))
                middle = time.perf_counter()
                scans.append(record(item).ranges)
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
    from repro.grid import Grid
    from repro.projection import project
    from repro.recording import record
    from repro.worlds import sample_world

    recorded = [record(sample_world(spec("4"), seed)) for seed in range(100)]
    ranges = torch.tensor(np.stack([r.ranges for r in recorded]), dtype=torch.float32)
    poses = torch.tensor(np.stack([r.poses for r in recorded]), dtype=torch.float32)
    angles, grid = torch.tensor(recorded[0].angles, dtype=torch.float32), Grid(256)
    began = time.perf_counter()
    for _ in range(runs // 100):
        images = project(ranges, angles, poses, grid)
    ours = time.perf_counter() - began
    began = time.perf_counter()
    slow = plain_projection(recorded[0].ranges, recorded[0].angles, recorded[0].poses, 256)
    plain = time.perf_counter() - began
    differ = np.count_nonzero(np.abs(slow - images[0].numpy().astype(int)) > 1)
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


def matrix_peak(device: str, dtype: torch.dtype) -> float:
    """Measured rate of a large matrix product [FLOP/s]."""
    size = 8192 if device == "cuda" else 4096
    a, b = (torch.randn(size, size, device=device, dtype=dtype) for _ in range(2))
    a @ b

    def product() -> None:
        a @ b
        if device == "cuda":
            torch.cuda.synchronize()

    return 2 * size**3 / clock(product, 5)


def bench_training(size_px: int, batch_size: int, pairs: int) -> None:
    """Our epoch against the plain one, and the share of it spent outside the batches' forward, backward and step."""
    from repro.models import ARCHITECTURES, create_model

    device = "cuda" if torch.cuda.is_available() else "cpu"
    precision = "bf16-mixed" if device == "cuda" else "32-true"
    peak = matrix_peak(device, torch.bfloat16 if device == "cuda" else torch.float32)
    title = f"Training at {size_px} px, batch {batch_size}, {precision} on {device}"
    title += f" ({peak / 1e9:.0f} GFLOP/s in a matrix product)"
    names = ("model", "plain [images/s]", "ours [images/s]", "ratio", "GFLOP/s", "of matrix rate", "between batches")
    heads(title, *names)
    for name in ARCHITECTURES:
        counter = FlopCounterMode(display=False)
        with counter:
            create_model(name)(torch.rand(1, 1, size_px, size_px).expand(2, -1, -1, -1)).sum().backward()
        operations = counter.get_total_flops() / 2
        plain = plain_epoch(name, size_px, batch_size, pairs, device)
        ours, between = our_epoch(name, size_px, batch_size, pairs, device, precision)
        row(
            name, f"{pairs / plain:.1f}", f"{pairs / ours:.1f}", f"{plain / ours:.2f} x",
            f"{operations * pairs / ours / 1e9:.0f}", f"{operations * pairs / ours / peak:.0%}",
            f"{between:.1%}",
        )  # fmt: skip


def plain_epoch(name: str, size_px: int, batch_size: int, pairs: int, device: str) -> float:
    """An epoch written the plain way: smp model, DataLoader, float32, eager [s]."""
    from repro.losses import MapLoss
    from repro.models import create_model

    model, loss = create_model(name).to(device), MapLoss()
    optimizer = torch.optim.Adam(model.parameters(), 1e-4)
    images, maps = torch.rand(pairs, 1, size_px, size_px), torch.rand(pairs, 1, size_px, size_px).round()
    loader = DataLoader(TensorDataset(images, maps), batch_size, shuffle=True, drop_last=True)

    def epoch() -> None:
        for image, target in loader:
            optimizer.zero_grad()
            loss(model(image.to(device)), target.to(device)).backward()
            optimizer.step()
        if device == "cuda":
            torch.cuda.synchronize()

    epoch()
    return clock(epoch, 1)


def our_epoch(name: str, size_px: int, batch_size: int, pairs: int, device: str, precision: str) -> tuple[float, float]:
    """An epoch of `training.train`'s own loop, validation left out: its time [s], its share between batches."""
    import lightning as L

    from repro.datasets import Pairs
    from repro.models import create_model
    from repro.training import Predictor, quiet

    quiet()
    images = torch.randint(0, 256, (pairs, 1, size_px, size_px), dtype=torch.uint8, device=device)
    data = Pairs(images, images // 128)
    config = {"learning_rate": 1e-4, "batch_size": batch_size, "dice_eps": 1e-6, "seed": 0}
    predictor = Predictor(create_model(name).to(memory_format=torch.channels_last), data, data, config)
    marks: list[float] = []
    batches: list[float] = []

    class Clock(L.Callback):
        def on_train_epoch_start(self, *_: Any) -> None:
            batches.clear()
            marks.append(time.perf_counter())

        def on_train_batch_start(self, *_: Any) -> None:
            batches.append(-time.perf_counter())

        def on_train_batch_end(self, *_: Any) -> None:
            batches.append(time.perf_counter())

        def on_train_epoch_end(self, *_: Any) -> None:
            predictor.train_loss().item()
            marks.append(time.perf_counter())

    trainer = L.Trainer(
        max_epochs=2, accelerator="gpu" if device == "cuda" else "cpu", devices=1, precision=precision,  # type: ignore[arg-type]
        callbacks=[Clock()], logger=False, enable_checkpointing=False, limit_val_batches=0,
        enable_progress_bar=False, enable_model_summary=False, reload_dataloaders_every_n_epochs=1,
    )  # fmt: skip
    trainer.fit(predictor)
    epoch_s = marks[3] - marks[2]
    return epoch_s, 1 - sum(batches) / epoch_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["recording", "projection", "training"])
    parser.add_argument("--size-px", type=int, default=256 if torch.cuda.is_available() else 64)
    parser.add_argument("--batch-size", type=int, default=16 if torch.cuda.is_available() else 8)
    parser.add_argument("--pairs", type=int, default=2048 if torch.cuda.is_available() else 160)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if "recording" in options.parts:
        bench_recording()
    if "projection" in options.parts:
        bench_projection()
    if "training" in options.parts:
        bench_training(options.size_px, options.batch_size, options.pairs)


if __name__ == "__main__":
    main()
