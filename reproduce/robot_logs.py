"""Test networks on logs of real robots: the beams outside of a cropped field of view measure what they did not see.

    python reproduce/robot_logs.py LOG [LOG ...]

crops the lidar of each log to 90 degrees, predicts the map at the end of every window and compares it with the other
beams of the same scan, as `task=predict prediction.fov_deg=90` does. Time is scaled so that the robot drives as far in
a window as in the training. The rows go to reproduce/results/robot_logs/held_out.csv, their origin to provenance.json.

The published rows are of logs in CARMEN format with poses corrected by a scan matcher, from the Robotics Data Set
Repository (Radish): https://github.com/acschaefer/ple/tree/master/data/carmen, also
https://www.ipb.uni-bonn.de/datasets.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from repro.metrics.bootstrap import bounds, draw_weights
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.agreement import agreement, last_seen, measured
from repro.prediction.logs import ScanLog
from repro.prediction.readers import read_log
from repro.prediction.windows import Window, cut
from repro.runs.provenance import environment
from repro.system.devices import one_thread
from repro.system.files import sha256, write_json, write_text

RESULTS = Path(__file__).parent / "results"
TARGET = RESULTS / "robot_logs"
WEIGHTS = ("rooms-16000/exppeople-convgru", "drive-16000/expmixed-convgru", "workstation/exp4-unet")
FOV, LEAST_SPACING_S, EVERY = math.pi / 2, 0.05, 10  # every tenth step ends a window
RADII = (0, 1, 2, 3)  # of the baseline [px]
PIXELS = ("all", "seen", "unseen")  # in the window
COUNTS = ["hits", "hits_on_obstacles", "passed", "passed_free"]


def time_of_step(log: ScanLog, predictor: Predictor) -> float:
    """Return the time of a step [s] with which the robot drives as far in a window as in the training (median)."""
    assert predictor.statistics, "published weights have them"
    driven_m = np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1).sum()
    speed_m_s = driven_m / (log.stamps[-1] - log.stamps[0])
    step_s = predictor.statistics.quantiles["path_m"][2] / predictor.steps / speed_m_s
    return float(max(step_s, np.median(np.diff(log.stamps)) / 5))  # five steps may share a scan, see windows.cut


def windows_of(path: Path, predictor: Predictor) -> Iterator[tuple[Window, int, float]]:
    """Cut a log; yield the windows that are on the map, the window's length of time each is in, and the range [m]."""
    step_s = time_of_step(read_log(path, LEAST_SPACING_S), predictor)
    log = read_log(path, min(step_s / 2, 1.0)).crop(FOV)
    steps, size_m = predictor.steps, predictor.grid.size_m
    for window in cut(log, steps=steps, step_s=step_s, stride_s=EVERY * step_s, center="robot", size_m=size_m):
        if isinstance(window, str):
            continue
        places = window.scans.poses[:, :2]
        if (places > 0).all() and (places < size_m).all():
            yield window, int((window.stamp - log.stamps[0]) // (steps * step_s)), min(log.range_max_m, 30.0)


def compare(window: Window, predictor: Predictor, range_max_m: float) -> list[dict[str, Any]]:
    """Compare the map of a network, and those of the last hits, with the held-out beams of a window."""
    grid = predictor.grid
    assert window.held_out, "the log is cropped"
    scan = measured(window.held_out, grid, range_max_m)
    maps = {"network": predictor.with_range(range_max_m).predict(window.scans, allow_empty=True)[0].numpy()}
    seen = np.zeros_like(scan.hits)
    for radius in RADII:
        maps[f"last_seen, {radius} px"], seen = last_seen(window.scans, grid, range_max_m, radius)
    rows = []
    for name, free in maps.items():
        for pixels, mask in zip(PIXELS, (np.ones_like(seen), seen, ~seen), strict=True):
            found = agreement(free, scan.within(mask))
            rows.append({"map": name, "pixels": pixels, **{count: getattr(found, count) for count in COUNTS}})
    return rows


def compared(path: Path, predictor: Predictor) -> list[dict[str, Any]]:
    """Compare the maps of all windows of a log."""
    windows = tqdm(windows_of(path, predictor), desc=path.name, disable=None)
    return [{"block": block} | row for window, block, reach in windows for row in compare(window, predictor, reach)]


def shares(counts: np.ndarray) -> np.ndarray:
    """Compute hits on obstacles, passed pixels free, and their mean, the balanced accuracy, from counts, (..., 4)."""
    with np.errstate(invalid="ignore"):
        found, free = counts[..., 1] / counts[..., 0], counts[..., 3] / counts[..., 2]
    return np.stack([found, free, (found + free) / 2], axis=-1)


def summarize(windows: pd.DataFrame) -> pd.DataFrame:
    """Sum the counts of each log and of all; intervals of 95 % of all, over stretches as long as a window."""
    rows = []
    for (weights, name, pixels), group in windows.groupby(["weights", "map", "pixels"], sort=False):
        blocks = group.groupby(["log", "block"])[COUNTS].sum().to_numpy()
        low, high = bounds(shares(draw_weights(len(blocks)) @ blocks))
        parts = {"all": group, **{log: part for log, part in group.groupby("log", sort=False)}}
        for log, part in parts.items():
            counts = part[COUNTS].sum()
            row = {"weights": weights, "map": name, "pixels": pixels, "log": log, "windows": len(part), **counts}
            for number, share in enumerate(("hits_share", "free_share", "balanced_accuracy")):
                row[share] = shares(counts.to_numpy())[number]
                row |= {f"{share}_low": low[number], f"{share}_high": high[number]} if log == "all" else {}
            rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    """Compare all networks with all logs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--weights", nargs="+", default=WEIGHTS, help="directories below reproduce/results")
    parser.add_argument("--target", type=Path, default=TARGET)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with one_thread():
        for weights in options.weights:
            predictor = load_predictor(RESULTS / weights)
            for path in options.logs:
                place = {"weights": weights, "log": path.name}
                try:
                    rows += [place | row for row in compared(path, predictor)]
                except ValueError as error:  # of a log whose windows would be too long
                    print(f"{weights}: leaves out {path.name}: {error}", flush=True)
    options.target.mkdir(parents=True, exist_ok=True)
    table = summarize(pd.DataFrame(rows))
    write_text(options.target / "held_out.csv", table.to_csv(index=False, float_format="%.4f"))
    logs = {path.name: sha256(path) for path in options.logs}
    write_json(options.target / "provenance.json", {"logs": logs, **environment()})
    print(table[table["log"] == "all"].to_string(index=False))


if __name__ == "__main__":
    main()
