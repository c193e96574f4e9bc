"""The measure of real logs in simulated places, with the true map of the same time as one of the predictions.

    python -m reproduce.real.bound [--worlds WORLDS] [--weights WEIGHTS ...] [--target DIRECTORY]

A lidar of 180 degrees drives through worlds of `places`. What its beams outside of the view of 90 degrees show at the
end is compared with the true map, with networks, and with maps without one, which are fitted to other worlds, half as
many. Robots that stand are left out. The rows go to upper_bound.csv in the target, their origin to provenance.json.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import maximum_filter
from tqdm import tqdm

from repro.learning.held_out import labeled, stands
from repro.learning.networks.trained import load_trained
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.metrics.counts import LEVELS
from repro.networks.predictor import Predictor
from repro.prediction.logs import ScanLog
from repro.prediction.times import window_of
from repro.runs.devices import one_thread
from repro.runs.provenance import environment
from repro.simulation.simulator import Recording, simulate
from repro.simulation.worlds import sample_world
from repro.system.files import write_json, write_text
from repro.system.places import conf_directory
from repro.world_config import read_world, world_spec
from reproduce.real.evidence import CENTER, evidence_at, join
from reproduce.real.fitting import Sample, counts_of, fit_others, maps_of
from reproduce.real.logs import VIEW, Case
from reproduce.real.measures import Measured, calibrated, count, neighbors, rows_of

RESULTS = Path(__file__).parents[1] / "results"
WEIGHTS = ("rooms-16000/exppeople-convgru", "places/exppeople-convgru")
TRUTH, FITTED, TESTED = "true map", "fitted", "tested"
FIRST_SEED = 900_000  # of the worlds, above those of all trainings
WALKED = 11  # steps: an obstacle moves if it has moved in the last second
GROUPS = ("all", "seen", "unseen", "standing", "moving")


def cases(seeds: range, predictor: Predictor) -> Iterator[tuple[Case, np.ndarray]]:
    """Yield the window of each world, and its true map at the end, 1 is free, (H, W)."""
    spec = world_spec(read_world(conf_directory() / "world" / "places.yaml"), "people")
    spec = spec.with_lidar(angle_range=math.pi, number=181)
    for seed in tqdm(seeds, disable=None):
        recording = simulate(sample_world(spec, seed))
        scans = recording.scans
        stamps = spec.world.step_time * np.arange(len(scans.poses))
        log = ScanLog(stamps, scans.ranges.astype(np.float32), scans.angles, scans.poses, range_max_m=VIEW.range_max_m)
        if not stands(log):
            for window, clear in labeled(log, window_of(predictor), 1, predictor.grid, VIEW):
                walks = np.ptp(recording.states[:, -WALKED:, :2], axis=1).max(-1) > 0
                people = true_map(recording, window.origin, predictor.grid, walks) == 0
                case = Case(window, VIEW.range_max_m, clear, clear.hits & maximum_filter(people, 3), seed)
                yield case, true_map(recording, window.origin, predictor.grid)


def true_map(
    recording: Recording, origin: tuple[float, float], grid: Grid, which: np.ndarray | slice = slice(None)
) -> np.ndarray:
    """Return the map of obstacles after the last step, 1 is free, (H, W); its lower left corner is at an origin."""
    states = recording.states[which, -1] - [*origin, 0]
    return rasterize(recording.outlines[which], states, np.zeros(len(states), int), 1, grid)[0]


def levels_of(case: Case, truth: np.ndarray, networks: dict[str, Predictor]) -> dict[str, np.ndarray]:
    """Return the levels of the true map and of each network at the compared pixels and those around them, (P, 9)."""
    free = {TRUTH: truth} | {name: case.map_of(predictor) for name, predictor in networks.items()}
    places = neighbors(case.pixels, len(truth))
    return {name: np.rint((LEVELS - 1) * image.ravel()[places]).astype(np.int64) for name, image in free.items()}


def compare(worlds: int, networks: dict[str, Predictor]) -> Iterator[dict[str, object]]:
    """Yield the rows of all maps, see `rows_of`, with differences of the true map less each other."""
    predictor = next(iter(networks.values()))
    others, tested = (range(FIRST_SEED, FIRST_SEED + worlds // 2), range(FIRST_SEED + worlds, FIRST_SEED + 2 * worlds))
    evidence, levels, free = [], [], []
    for case, truth in cases(others, predictor):
        evidence.append(evidence_at(case, predictor.grid, case.pixels))
        levels.append({name: each.min(1) for name, each in levels_of(case, truth, networks).items()})
        free.append(case.free)
    found = np.concatenate(free)
    joined = {name: np.concatenate([each[name] for each in levels]) for name in levels[0]}
    fitted = fit_others({FITTED: Sample(join(evidence), joined[TRUTH], found)}, TESTED)
    counts: dict[str, list[np.ndarray]] = {}
    for case, truth in cases(tested, predictor):
        own = evidence_at(case, predictor.grid, case.pixels)
        groups = list(case.groups(own.seen[:, CENTER]).values())
        for name, each in (levels_of(case, truth, networks) | maps_of(own, fitted)).items():
            counts.setdefault(name, []).append(count(each, groups, case.pixels))
    probability = fitted.probability | {name: calibrated(counts_of(each, found)) for name, each in joined.items()}
    maps = {name: {"worlds": Measured(len(each), np.stack(each), probability[name])} for name, each in counts.items()}
    yield from (row for row in rows_of(maps, GROUPS, TRUTH) if row["log"] != "worlds")


def main() -> None:
    """Compare all maps and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=400)
    parser.add_argument("--weights", nargs="+", default=WEIGHTS, help="directories below reproduce/results")
    parser.add_argument("--target", type=Path, default=RESULTS / "buildings" / "upper_bound")
    options = parser.parse_args()
    origin = environment()  # before the results change the working tree
    with one_thread():
        networks = {f"network {name}": load_trained(RESULTS / name) for name in options.weights}
        table = pd.DataFrame(compare(options.worlds, networks))
    options.target.mkdir(parents=True, exist_ok=True)
    write_text(options.target / "upper_bound.csv", table.to_csv(index=False, float_format="%.4f"))
    write_json(options.target / "provenance.json", {"worlds": options.worlds, **origin})
    print(table[["map", "pixels", "windows", "auroc", "auroc_low", "auroc_high"]].to_string())


if __name__ == "__main__":
    main()
