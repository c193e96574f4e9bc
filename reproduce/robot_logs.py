"""Test networks on logs of real robots: their maps are compared with the beams outside of a cropped field of view.

    python reproduce/robot_logs.py LOG [LOG ...]

crops the lidar of each log to 90 degrees, predicts the map at the end of every window and compares it with the other
beams of the last scan. The maps of `log_evidence` need no network; whatever they fit or choose is from the other logs.
The rows go to reproduce/results/robot_logs/held_out.csv, their origin to provenance.json. One window is drawn for the
first weights.

The published rows are of gzipped logs in CARMEN format with poses corrected by a scan matcher, from the Robotics Data
Set Repository (Radish): https://github.com/acschaefer/ple/tree/master/data/carmen, see also
https://www.ipb.uni-bonn.de/datasets. They have a scan every 0.5 to 1 m (freiburg-079: every 0.09 m), and some have lost
their times. Therefore time counts scans. The time of a step is such that the robot drives as far in a window as in the
training, but at most ten steps have the same scan.
"""

import argparse
import gzip
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from log_evidence import CONSTANTS, Evidence, distance_map, evidence_of, fit, regression_map, score_map
from scipy.ndimage import maximum_filter, minimum_filter
from sklearn.metrics import roc_auc_score
from sklearn.pipeline import Pipeline
from tqdm import tqdm

from repro.metrics.bootstrap import bounds, draw_weights
from repro.metrics.counts import LEVELS, confusion_of
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.agreement import Observed, observed
from repro.prediction.logs import ScanLog, collect
from repro.prediction.output import draw
from repro.prediction.readers import carmen_scans
from repro.prediction.windows import Window, cut
from repro.runs.provenance import environment
from repro.system.devices import one_thread
from repro.system.errors import InputError
from repro.system.files import sha256, write_json, write_text

RESULTS = Path(__file__).parent / "results"
TARGET = RESULTS / "robot_logs"
WEIGHTS = ("rooms-16000/exppeople-convgru", "drive-16000/expmixed-convgru", "workstation/exp4-unet")
FOV, REACH_M = math.pi / 2, 30.0
STRIDE = 10  # every tenth step ends a window
SHARED = 10  # steps that may have the same scan, see windows.cut
FITTED_EVERY = 6  # windows of the logs from which the maps of other logs are fitted
FITTED_PIXELS = 300  # of each of these windows
PIXELS = ("all", "seen", "unseen")  # in the window
MEASURES = ("auroc", "hits_share", "free_share")
NETWORK, DISTANCE, SCORE = "network", "distance to the last hits", "counts and distances"
REGRESSION, WALLS = "regression", "regression with continued walls"
KEY = ["weights", "map", "pixels", "log"]
DRAWN = ("freiburg-079-corrected.log.gz", 260)  # log and number of the window that is drawn
Counts = dict[str, np.ndarray]  # of a log, by map: pixels by `PIXELS`, truth (hits first) and level, (3, 2, 256)


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


@dataclass(frozen=True)
class Compared:
    """A window with what the held-out beams show, and the evidence of its scans."""

    window: Window
    scan: Observed
    evidence: Evidence
    reach_m: float


def compared_windows(path: Path, predictor: Predictor, every: int = 1) -> Iterator[Compared]:
    """Yield every n-th window of a log with its evidence."""
    windows = enumerate(windows_of(path, predictor))
    chosen = ((window, reach_m) for number, (window, reach_m) in windows if number % every == 0)
    for window, reach_m in tqdm(chosen, desc=path.name, disable=None):
        assert window.held_out, "the log is cropped"
        scan = observed(window.held_out, predictor.grid, reach_m)
        yield Compared(window, scan, evidence_of(window.scans, predictor.grid, reach_m), reach_m)


@dataclass(frozen=True)
class Sample:
    """A part of the windows of a log: features and truth of some pixels, and counts of the candidate scores.

    Args:
        designs: features without and with continued walls, (P, F) each.
        free: whether the held-out beams passed over the pixels, bool, (P,).
        scores: counts of all pixels for each of `CONSTANTS`, (2, 256) each.
    """

    designs: tuple[np.ndarray, np.ndarray]
    free: np.ndarray
    scores: list[np.ndarray]


def sample(path: Path, predictor: Predictor) -> Sample:
    """Collect the sample of a log from which the maps of other logs are fitted."""
    rng = np.random.default_rng(0)
    designs: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    free, scores = [], np.zeros((len(CONSTANTS), 2, LEVELS), dtype=int)
    for each in compared_windows(path, predictor, FITTED_EVERY):
        pixels = np.flatnonzero(each.scan.hits | each.scan.passed)
        pixels = rng.permutation(pixels)[:FITTED_PIXELS]
        for walls in (False, True):
            designs[walls].append(each.evidence.design(walls)[pixels])
        free.append(each.scan.passed.ravel()[pixels])
        everywhere = np.ones_like(each.evidence.seen)
        for number, constants in enumerate(CONSTANTS):
            scores[number] += next(count(score_map(each.evidence, *constants), each.scan, [everywhere]))
    return Sample((np.concatenate(designs[0]), np.concatenate(designs[1])), np.concatenate(free), list(scores))


@dataclass(frozen=True)
class Fitted:
    """What is fitted on the other logs: constants of the score, and the regressions without and with walls."""

    constants: tuple[float, float]
    models: tuple[Pipeline, Pipeline]


def fit_others(samples: dict[str, Sample], tested: str) -> Fitted:
    """Fit on all logs but the tested one: the constants with the best mean AUROC, and the regressions."""
    others = [each for log, each in samples.items() if log != tested]
    auroc = [np.nanmean([measures(each.scores[n])[0] for each in others]) for n in range(len(CONSTANTS))]
    models = tuple(fit([each.designs[walls] for each in others], [each.free for each in others]) for walls in (0, 1))
    return Fitted(CONSTANTS[int(np.argmax(auroc))], models)  # type: ignore[arg-type]


def maps_of(each: Compared, predictor: Predictor, fitted: Fitted) -> dict[str, np.ndarray]:
    """Return the levels of all maps of a window, (H, W) each."""
    free = predictor.with_range(each.reach_m).predict(each.window.scans, allow_empty=True)[0].numpy()
    return {
        NETWORK: np.rint((LEVELS - 1) * free).astype(np.int64),
        DISTANCE: distance_map(each.evidence),
        SCORE: score_map(each.evidence, *fitted.constants),
        REGRESSION: regression_map(each.evidence, fitted.models[0], walls=False),
        WALLS: regression_map(each.evidence, fitted.models[1], walls=True),
    }


def compare(path: Path, predictor: Predictor, fitted: Fitted, figures: Path | None) -> tuple[int, Counts]:
    """Compare all maps of a log with the held-out beams; return the number of windows and the counts of each map."""
    counts: Counts = defaultdict(lambda: np.zeros((len(PIXELS), 2, LEVELS), dtype=int))
    windows = 0
    for each in compared_windows(path, predictor):
        windows += 1
        seen, maps = each.evidence.seen, maps_of(each, predictor, fitted)
        for name, levels in maps.items():
            counts[name] += np.stack(list(count(levels, each.scan, (np.ones_like(seen), seen, ~seen))))
        if (path.name, each.window.number) == DRAWN and figures:
            figure = draw(each.window, maps[NETWORK] / (LEVELS - 1), predictor.grid)
            figure.axes[1].set_title("predicted map")  # its time is a number of scans
            figure.savefig(figures / "window.png", dpi=120)
    return windows, counts


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


def rows_of(weights: str, log: str, windows: int, counts: Counts) -> Iterator[dict[str, Any]]:
    """Yield a row per map and kind of pixels of a log."""
    for name, of_map in counts.items():
        for pixels, of_pixels in zip(PIXELS, of_map, strict=True):
            row = {"weights": weights, "map": name, "pixels": pixels, "log": log, "windows": windows}
            row |= dict(zip(("hits", "passed"), of_pixels.sum(-1), strict=True))
            yield row | dict(zip(MEASURES, measures(of_pixels), strict=True))


def with_means(table: pd.DataFrame) -> pd.DataFrame:
    """Put the means over the logs before the rows of the logs, with intervals of 95 % from logs drawn with replacement.

    `gain` of a map without a network is the AUROC of the network less that of the map.
    """
    means = []
    for (weights, name, pixels), rows in table.groupby(["weights", "map", "pixels"], sort=False):
        network = table.query("weights == @weights and map == @NETWORK and pixels == @pixels").set_index("log")
        rows = rows.set_index("log")
        gain = {} if name == NETWORK else {"gain": network["auroc"] - rows["auroc"]}
        values = rows[list(MEASURES)].assign(**gain).dropna()
        row: dict[str, Any] = {"weights": weights, "map": name, "pixels": pixels, "log": "mean"}
        row |= {total: rows[total].sum() for total in ("windows", "hits", "passed")} | {"logs": len(values)}
        low, high = bounds(draw_weights(len(values)) @ values.to_numpy() / len(values))
        for number, measure in enumerate(map(str, values.columns)):
            row |= {measure: values[measure].mean(), f"{measure}_low": low[number], f"{measure}_high": high[number]}
        means.append(row)
    return pd.concat([pd.DataFrame(means), table], ignore_index=True)


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
    chosen: dict[str, dict[str, tuple[float, float]]] = {}
    with one_thread():
        for weights in options.weights:
            predictor, is_first = load_predictor(RESULTS / weights), weights == options.weights[0]
            samples = {path.name: sample(path, predictor) for path in options.logs}
            fitted = {path.name: fit_others(samples, path.name) for path in options.logs}
            chosen[weights] = {log: each.constants for log, each in fitted.items()}
            for path in options.logs:
                compared = compare(path, predictor, fitted[path.name], options.target if is_first else None)
                rows += rows_of(weights, path.name, *compared)
    table = with_means(pd.DataFrame(rows))
    write_text(options.target / "held_out.csv", table.to_csv(index=False, float_format="%.4f"))
    logs = {path.name: sha256(path) for path in options.logs}
    write_json(options.target / "provenance.json", {"logs": logs, "constants": chosen, **origin})
    print(table[table["log"] == "mean"].to_string(index=False))


if __name__ == "__main__":
    main()
