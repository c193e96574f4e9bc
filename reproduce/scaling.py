"""Measure the time of a map against the number of obstacles: of the classical tracker, and of U-Net.

    python -m reproduce.scaling

takes windows of experiment 4 with other numbers of obstacles at the paper's coverage (reproduce/worlds), and
measures the CPU time of one map at 128 px, with the published settings of the tracker and the published network. The
times go to reproduce/results/scaling, with the growth from 10 to 40 obstacles relative to that of U-Net.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from repro.baselines.tracker import Prior, clusters, distances, track
from repro.networks.predictor import load_predictor
from repro.runs.devices import one_thread
from repro.runs.provenance import environment
from repro.scans import Scans
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate
from repro.system.files import write_json, write_text
from repro.worlds.spec import world_spec
from reproduce.worlds.families import NUMBER, Family, world_of

TARGET = Path(__file__).parent / "results" / "scaling"
NUMBERS, WINDOWS, EXPERIMENT, STEP_S = (5, 10, 20, 40), 30, "4", 0.1
NEAR_M, COAST_S = 1.0, 10.0  # of the published tracker of experiment 4 at 128 px, as the prior


def windows(number: int) -> list[Scans]:
    """Return the scans of worlds with a number of obstacles."""
    spec = world_spec(world_of(Family(number, clear_m=8.5)), EXPERIMENT)
    return [simulate(sample_world(spec, seed)).scans for seed in range(WINDOWS)]


def cpu_ms(predict: Callable[[Scans], object], scans: list[Scans]) -> np.ndarray:
    """Measure the CPU time of the map of each window [ms], the less of two calls."""
    times = np.empty((2, len(scans)))
    for call, index in np.ndindex(times.shape):
        began = time.process_time()
        predict(scans[index])
        times[call, index] = time.process_time() - began
    return 1000 * times.min(0)


def main() -> None:
    """Measure both, and write the times, the growth and where they come from."""
    origin, network, times = environment(), load_predictor("exp4"), {}
    with one_thread():
        for number in NUMBERS:
            prior = Prior(2.85 * (NUMBER / number) ** 0.5, 0.4, 1.4, 0.2, 5.0)

            def tracked(scans: Scans, prior: Prior = prior) -> np.ndarray:
                return distances(track(clusters(scans, STEP_S, NEAR_M), prior), network.grid, COAST_S)

            scans = windows(number)
            times[number, "tracker"], times[number, "unet"] = cpu_ms(tracked, scans), cpu_ms(network.predict, scans)
            means = (times[number, name].mean().item() for name in ("tracker", "unet"))
            print(
                f"{number} obstacles: tracker and U-Net take " + ", ".join(f"{ms:.1f} ms" for ms in means), flush=True
            )
    (TARGET / "analysis").mkdir(parents=True, exist_ok=True)
    rows = [{"obstacles": n, "model": name, "cpu_ms": each.mean()} for (n, name), each in times.items()]
    write_text(TARGET / "times.csv", pd.DataFrame(rows).to_csv(index=False, float_format="%.4g"))
    write_text(TARGET / "analysis" / "scaling.csv", growth(times).to_csv(index=False, float_format="%.4g"))
    write_json(TARGET / "provenance.json", {"windows": WINDOWS, "experiment": EXPERIMENT, **origin})


def growth(times: dict[tuple[int, str], np.ndarray]) -> pd.DataFrame:
    """Return by what factor the tracker's time grows relative to U-Net's, with its interval over windows."""
    drawn = np.random.default_rng(0).integers(WINDOWS, size=(2000, WINDOWS))
    grown = {name: [times[n, name][drawn].mean(1) for n in (40, 10)] for name in ("tracker", "unet")}
    ratio = (grown["tracker"][0] / grown["tracker"][1]) / (grown["unet"][0] / grown["unet"][1])
    low, high = np.quantile(ratio, [0.025, 0.975])
    about = {"experiment": EXPERIMENT, "model": "unet", "encoding": "projection", "metric": "growth"}
    return pd.DataFrame([{**about, "value": np.median(ratio), "low": low, "high": high}])


if __name__ == "__main__":
    main()
