"""Check published rows: record the 500 test pairs of experiment 4 and evaluate the published U-Net and ConvGRU.

    python -m reproduce.check

prints their metrics beside the stored rows and the paper's, U-Net's SSIM in bfloat16 over that in float32, and the
coverage, visibility and misfit of the best other worlds, and ends with status 1 if one differs from its stored value by
more than `TOLERANCE`, which the rounding of the published weights to float16 explains.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from repro.evaluation.scoring import measure
from repro.learning.networks.trained import load_trained
from repro.maps.grid import Grid
from repro.metrics.headings import METRICS
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import load_recorded
from repro.reporting.paper import read_paper
from repro.reporting.results import read_rows
from repro.runs.devices import one_thread
from repro.simulation.recorder import record_experiment
from repro.worlds.spec import read_world, world_spec
from reproduce.ssim import PAIRS, SIZE_PX, compare, enlarged
from reproduce.worlds.__main__ import SCREEN, screened, statistics

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "reproduce" / "results"
EXPERIMENT, SEED = "4", 0
PUBLISHED = {  # network: directory of its row, its input, directory of its weights
    "unet": ("workstation", "projection", "workstation/exp4-unet"),
    "convgru": ("workstation-16000", "series10", "workstation-16000/exp4-convgru"),
}
SHOWN = [*METRICS, "obstacle_iou"]
TOLERANCE = 0.0005


def stored_row(directory: str, model: str, encoding: str) -> pd.Series:
    """Read the row of a published run."""
    rows = pd.read_csv(RESULTS / directory / "runs.csv", dtype={"experiment": str})
    chosen = (rows["model"] == model) & (rows["encoding"] == encoding) & (rows["seed"] == SEED)
    return rows[chosen & (rows["experiment"] == EXPERIMENT)].iloc[0][SHOWN].astype(float)


def worlds_apart(family: str = "little-faster") -> float:
    """Measure other worlds again; print statistics and misfit, return the largest difference from the stored ones."""
    stored = {name: read_rows(RESULTS / "worlds" / f"{name}.csv") for name in ("statistics", "cells", "families")}
    cells, families = (stored[name][stored[name]["scale"] == SCREEN] for name in ("cells", "families"))
    worst = 0.0
    for published, found in ((stored["statistics"], statistics(family)), (families, screened(cells))):
        before, now = (rows[rows["family"] == family].select_dtypes(float) for rows in (published, found))
        print(now.to_string(index=False, float_format="{:.4f}".format))
        worst = max(worst, np.abs(now.to_numpy() - before[now.columns].to_numpy()).max())
    return worst


def main() -> int:
    """Record, evaluate and compare; return the exit status."""
    recordings = ROOT / "outputs" / "check" / "recordings" / f"exp{EXPERIMENT}"
    print("recording 500 test pairs of experiment 4: a quarter of a minute on two idle cores", flush=True)
    spec = world_spec(read_world(ROOT / "conf" / "world" / "paper.yaml"), EXPERIMENT)
    record_experiment(recordings, spec, {"train": 2, "val": 2, "test": 500})
    test = load_recorded(open_recordings(recordings), "test", Grid(128, 50.0))
    paper = read_paper().query("experiment == @EXPERIMENT and encoding == 'projection'").set_index("model")[[*METRICS]]
    worst, rows, ratio = 0.0, {("unet", "paper"): paper.loc["unet"]}, 0.0
    for model, (directory, encoding, weights) in PUBLISHED.items():
        print(f"predicting 500 maps: {model}", flush=True)
        with one_thread():
            free = load_trained(RESULTS / weights).predict(test.scans)[:, None]
        stored, (now, _) = stored_row(directory, model, encoding), measure(free, test.maps)
        worst = max(worst, (now[SHOWN].astype(float) - stored).abs().max())
        rows |= {(model, "published"): stored, (model, "now"): now[SHOWN]}
        if model == "unet":
            print("comparing SSIM in float32 and bfloat16", flush=True)
            fine = load_recorded(open_recordings(recordings), "test", Grid(SIZE_PX, 50.0)).maps[:PAIRS]
            ratio = compare(enlarged(free[:PAIRS, 0]), fine, "bfloat16", "gpu")["ratio"]
    print(pd.DataFrame(rows).T.to_string(float_format="{:.4f}".format, na_rep=""))
    autocast = pd.read_csv(RESULTS / "ssim" / "autocast.csv").query(
        f"experiment == {EXPERIMENT} and model == 'unet' and temperature == 1 and type == 'bfloat16' and rules == 'gpu'"
    )["ratio"]
    print(f"SSIM in bfloat16 over that in float32, U-Net: {ratio:.4f} (published: {autocast.item():.4f})")
    worst = max(worst, abs(ratio - autocast.item()), worlds_apart())
    print(f"largest difference from the published rows: {worst:.6f} (allowed: {TOLERANCE})")
    return int(worst > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main())
