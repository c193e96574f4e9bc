"""Benchmark encodings of 10,000 runs: the projection point by point and vectorized, and series of images."""

import resource
import time

import numpy as np
from recording import world_of
from table import head, row

from repro.maps.encodings import Encoding, create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.scans import Scans
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate
from repro.system.threads import count_threads

RUNS = 10_000


def bench_projection() -> None:
    """Print the times for all runs, extrapolated from 100 runs or fewer."""
    each = [simulate(sample_world(world_of("4"), seed)).scans for seed in range(100)]
    scans, grid = Scans.stack(each), Grid(256, 50.0)
    images, ours = _encode(Projection(), scans.batched(), grid, rounds=20)
    began = time.perf_counter()
    slow = plain_projection(scans.ranges[0], scans.angles, scans.poses[0], 256)
    plain = (time.perf_counter() - began) * RUNS
    head(f"Projection to 256 x 256, {count_threads()} threads", "way", f"{RUNS:,} runs", "ratio")
    row("one point at a time", f"{plain:.0f} s", "1 x")
    row("ours", f"{ours:.1f} s", f"{plain / ours:.0f} x")
    differing = np.count_nonzero(np.abs(slow - images[0, 0].astype(int)) > 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    for size_px in (64, 128):
        grid = Grid(size_px, 50.0)
        _, once = _encode(Projection(), scans.batched(), grid, rounds=20)
        _, series = _encode(create_encoding("series10", {"frames": 10}), scans.batched(), grid, rounds=5)
        row(f"series10, {size_px} px", f"{series:.1f} s", f"{series / once:.1f} of the projection there")
    print(f"\nPixels that differ in the first run: {differing} (float32, float64). Peak memory: {peak:.2f} GB")


def _encode(encoding: Encoding, windows: Scans, grid: Grid, rounds: int) -> tuple[np.ndarray, float]:
    """Return the images of the windows and the time for all runs [s]."""
    images = encoding.encode(windows, grid)
    began = time.perf_counter()
    for _ in range(rounds):
        images = encoding.encode(windows, grid)
    return images, (time.perf_counter() - began) * RUNS / (rounds * len(images))


def plain_projection(ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray, size_px: int) -> np.ndarray:
    """Draw the image of one run point by point in float64, (size_px, size_px)."""
    image = np.full((size_px, size_px), 255)
    for step, (x, y, heading) in enumerate(poses):
        for distance, angle in zip(ranges[step], angles, strict=True):
            if np.isfinite(distance):
                column = int(np.floor((x + distance * np.cos(heading + angle)) / 50 * size_px))
                row_px = size_px - 1 - int(np.floor((y + distance * np.sin(heading + angle)) / 50 * size_px))
                if 0 <= row_px < size_px and 0 <= column < size_px:
                    image[row_px, column] = round(255 * 0.8 * (1 - step / 99))
    return image
