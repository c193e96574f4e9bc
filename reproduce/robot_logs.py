"""Test networks on logs of real robots: their maps are compared with the beams outside of a cropped field of view.

    python reproduce/robot_logs.py LOG [LOG ...]

crops the lidar of each log to 90 degrees, predicts the map at the end of every window and compares it with the other
beams of the last scan. The rows go to reproduce/results/robot_logs/held_out.csv, their origin to provenance.json. One
window is drawn for the first weights.

The published rows are of gzipped logs in CARMEN format with poses corrected by a scan matcher, from the Robotics Data
Set Repository (Radish): https://github.com/acschaefer/ple/tree/master/data/carmen, see also
https://www.ipb.uni-bonn.de/datasets. They have a scan every 0.5 to 1 m (freiburg-079: every 0.09 m), and some have lost
their times. Therefore time counts scans. The time of a step is such that the robot drives as far in a window as in the
training, but at most ten steps have the same scan.
"""

import argparse
import gzip
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter
from sklearn.metrics import roc_auc_score
from tqdm import tqdm

from repro.maps.grid import Grid
from repro.metrics.bootstrap import bounds, draw_weights
from repro.metrics.counts import LEVELS, confusion_of
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.agreement import Observed, last_hits, observed
from repro.prediction.logs import ScanLog, collect
from repro.prediction.output import draw
from repro.prediction.readers import carmen_scans
from repro.prediction.windows import Window, cut
from repro.runs.provenance import environment
from repro.scans import Scans
from repro.system.devices import one_thread
from repro.system.errors import InputError
from repro.system.files import sha256, write_json, write_text

RESULTS = Path(__file__).parent / "results"
TARGET = RESULTS / "robot_logs"
WEIGHTS = ("rooms-16000/exppeople-convgru", "drive-16000/expmixed-convgru", "workstation/exp4-unet")
FOV, REACH_M = math.pi / 2, 30.0
STRIDE = 10  # every tenth step ends a window
SHARED = 10  # steps that may have the same scan, see windows.cut
PIXELS = ("all", "seen", "unseen")  # in the window
MEASURES = ("auroc", "hits_share", "free_share")
NETWORK, BASELINE = "network", "distance to the last hits"
KEY = ["weights", "map", "pixels", "log"]
DRAWN = ("freiburg-079-corrected.log.gz", 260)  # log and number of the window that is drawn


def read(path: Path) -> ScanLog:
    """Read a gzipped CARMEN log; the time of a scan is its number."""
    with gzip.open(path, "rt", encoding="utf-8", errors="replace") as lines:
        scans = [replace(scan, stamp=float(number)) for number, scan in enumerate(carmen_scans(lines, path))]
    return collect(scans, path, 0.0)


def windows_of(path: Path, predictor: Predictor) -> Iterator[tuple[Window, float]]:
    """Yield the windows of a log, and the maximum range of the lidar [m].

    The robot drives as far in a window as in the training (median), or as far as in ten scans if that is more.
    """
    log = read(path).crop(FOV)
    assert predictor.statistics, "published weights have them"
    driven_m = np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1).sum()
    scans = predictor.statistics.quantiles["path_m"][2] * (len(log) - 1) / driven_m  # in a window
    steps = predictor.steps
    step = float(max(scans / steps, 1 / SHARED))
    options = {"stride_s": STRIDE * step, "center": "robot", "size_m": predictor.grid.size_m}
    for window in cut(log, steps=steps, step_s=step, **options):  # type: ignore[arg-type]
        if isinstance(window, str):
            raise InputError(f"{path}: {window}")
        yield window, min(log.range_max_m, REACH_M)


def distance_to_hits(scans: Scans, grid: Grid, range_max_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Predict a map without a network: pixels are the more likely free the farther they are from the last hits.

    A pixel that a beam has passed over is more likely free than any that no beam has reached.

    Returns:
        levels from 0, the last hits, to 255, certainly free, (H, W): those of unseen pixels begin at 128 and those of
        passed ones at 192; and the pixels that any beam of the window has hit or passed over, bool.
    """
    free, seen = last_hits(scans, grid, range_max_m)
    is_hit = free < 0.5
    distance = distance_transform_edt(~is_hit) if is_hit.any() else np.full(free.shape, np.inf)
    with np.errstate(divide="ignore"):
        level = LEVELS // 2 + np.minimum(np.rint(8 * np.log2(distance)), LEVELS // 4 - 1)  # eighths of an octave
    return np.where(is_hit, 0, level + np.where(seen, LEVELS // 4, 0)).astype(np.int64), seen


def compared(path: Path, predictor: Predictor, figures: Path | None) -> Iterator[dict[str, Any]]:
    """Compare the maps of all windows of a log with the held-out beams: counts by truth and predicted value, (2, 256).

    The counts are those of `metrics.counts`: hits first, then passed pixels. `DRAWN` is drawn to `figures`.
    """
    for window, reach_m in tqdm(windows_of(path, predictor), desc=path.name, disable=None):
        assert window.held_out, "the log is cropped"
        scan = observed(window.held_out, predictor.grid, reach_m)
        baseline, seen = distance_to_hits(window.scans, predictor.grid, reach_m)
        free = predictor.with_range(reach_m).predict(window.scans, allow_empty=True)[0].numpy()
        if (path.name, window.number) == DRAWN and figures:
            figure = draw(window, free, predictor.grid)
            figure.axes[1].set_title("predicted map")  # its time is a number of scans
            figure.savefig(figures / "window.png", dpi=120)
        network = np.rint((LEVELS - 1) * free).astype(np.int64)
        for name, levels in ((NETWORK, network), (BASELINE, baseline)):
            counts = count(levels, scan, (np.ones_like(seen), seen, ~seen))
            for pixels, each in zip(PIXELS, counts, strict=True):
                yield {"map": name, "pixels": pixels, "counts": each}


def count(levels: np.ndarray, scan: Observed, masks: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """Count the pixels of a scan within each mask by truth, hits first, and level of a map, (2, 256).

    Poses and grids are not exact, so every pixel takes the lowest level within one pixel, hits and passed pixels alike,
    and passed pixels beside a hit are left out. A map that does not depend on the scan thus has an AUROC of 0.5.
    """
    nearby = minimum_filter(levels, 3)
    clear = Observed(scan.hits, scan.passed & ~maximum_filter(scan.hits, 3))
    for mask in masks:
        within = clear.within(mask)
        yield np.stack([np.bincount(nearby[pixels], minlength=LEVELS) for pixels in (within.hits, within.passed)])


def measures(counts: np.ndarray) -> np.ndarray:
    """Compute `MEASURES` from counts, (2, 256); NaN without hits or without passed pixels."""
    if not counts.any(axis=1).all():
        return np.full(len(MEASURES), np.nan)
    is_passed, level = np.indices(counts.shape).reshape(2, -1)
    free, missed, found, wrong = confusion_of(counts)
    auroc = roc_auc_score(is_passed, level, sample_weight=counts.ravel())
    return np.array([auroc, found / (found + missed), free / (free + wrong)])


def summarize(windows: pd.DataFrame) -> pd.DataFrame:
    """Pool the windows of each log; average over the logs, with intervals of 95 % from logs drawn with replacement."""
    logs = []
    for key, group in windows.groupby(KEY, sort=False):
        counts = np.stack(group["counts"].to_list()).sum(0)
        sums = {"windows": len(group), **dict(zip(("hits", "passed"), counts.sum(-1), strict=True))}
        logs.append(dict(zip(KEY, key, strict=True)) | sums | dict(zip(MEASURES, measures(counts), strict=True)))
    table = pd.DataFrame(logs)
    means = [mean_of(table[table["weights"].eq(weights)]) for weights in table["weights"].unique()]
    return pd.concat([*means, table], ignore_index=True)


def mean_of(table: pd.DataFrame) -> pd.DataFrame:
    """Average the rows of one network over the logs; `gain` is its AUROC less that of the baseline."""
    rows = []
    for pixels in PIXELS:
        of_pixels = table[table["pixels"] == pixels]
        each = {name: of_pixels[of_pixels["map"] == name].set_index("log") for name in (NETWORK, BASELINE)}
        gain = each[NETWORK]["auroc"] - each[BASELINE]["auroc"]
        for name, of_logs in each.items():
            row: dict[str, Any] = {"weights": of_logs["weights"].iloc[0], "map": name, "pixels": pixels, "log": "mean"}
            row |= {count: of_logs[count].sum() for count in ("windows", "hits", "passed")}
            values = of_logs[list(MEASURES)].assign(**({"gain": gain} if name == NETWORK else {})).dropna()
            row["logs"] = len(values)
            weights = draw_weights(len(values))
            low, high = bounds(weights @ values.to_numpy() / len(values))
            for number, measure in enumerate(map(str, values.columns)):
                row |= {measure: values[measure].mean(), f"{measure}_low": low[number], f"{measure}_high": high[number]}
            rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    """Compare all networks with all logs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--weights", nargs="+", default=WEIGHTS, help="directories below reproduce/results")
    parser.add_argument("--target", type=Path, default=TARGET)
    options = parser.parse_args()
    origin = environment()  # before the results change the working tree
    options.target.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    with one_thread():
        for weights in options.weights:
            predictor, is_first = load_predictor(RESULTS / weights), weights == options.weights[0]
            for path in options.logs:
                place = {"weights": weights, "log": path.name}
                rows += [place | row for row in compared(path, predictor, options.target if is_first else None)]
    table = summarize(pd.DataFrame(rows))
    write_text(options.target / "held_out.csv", table.to_csv(index=False, float_format="%.4f"))
    logs = {path.name: sha256(path) for path in options.logs}
    write_json(options.target / "provenance.json", {"logs": logs, **origin})
    print(table[table["log"] == "mean"].to_string(index=False))


if __name__ == "__main__":
    main()
