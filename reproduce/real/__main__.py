"""Compare networks and maps without a network with logs of real lidars, as they are delivered.

    python -m reproduce.real LOG [LOG ...] --adapted WEIGHTS [--weights WEIGHTS ...] [--target DIRECTORY]

A part of the beams is kept from all maps, see `repro.learning.held_out`; at the end of every window, the maps are
compared with the pixels that these beams hit or passed over. A network is called as its user calls it, and each pixel
is compared with its own probability. Since poses and grids are not exact, the rows with the score `within one pixel`
also compare the least probability of free there, calibrated on logs of other places: a map that no user receives.

The network of --adapted is adapted to the logs of two thirds of the places, as task=adapt does, and tested on the
others; those of --weights are tested as they are. Maps without a network are fitted to the same logs as the adapted
network. The boosting is tuned on the development logs among these, where these are of two places or more. With
--all, the network is adapted to all logs, too. The target, by default outputs/real, gets held_out.csv and its origin.

The published rows are of the gzipped CARMEN logs with poses corrected by a scan matcher of the Robotics Data Set
Repository (Radish), https://github.com/acschaefer/ple/tree/master/data/carmen, see also
https://www.ipb.uni-bonn.de/datasets; of logs of Wean Hall with odometry,
https://github.com/deanhgit/16-831_Lab1/tree/master/log; and of bags of a standing lidar among people (BSD-3),
https://github.com/angusleigh/leg_tracker/tree/melodic/rosbags/training/scans_res_0_33/positive_not_extracted. Others
are of floors of KTH, the directories of https://github.com/castacks/MapEx/tree/main/kth_test_maps.
"""

import argparse
import copy
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from joblib import delayed
from tqdm import tqdm

from repro.learning.kernels import accelerate
from repro.learning.networks.trained import TorchNetwork, load_trained, module_of
from repro.metrics.counts import LEVELS, PROBABILITY
from repro.networks.predictor import Predictor
from repro.runs.devices import one_thread
from repro.runs.parallel import count_cores, process_pool
from repro.runs.provenance import environment
from repro.scans import Scans
from repro.system.files import sha256, write_json, write_text
from reproduce.calls import reported
from reproduce.real import maps
from reproduce.real.adapted import adapted, adapted_to_all
from reproduce.real.figure import draw
from reproduce.real.floors import PLAN, is_floor
from reproduce.real.logs import DEVELOPMENT, FOLDS, Case, cases_of, check, fold_of, kind_of, place_of
from reproduce.real.maps import Fitted, Sample
from reproduce.real.measures import Measured, around, auroc, calibrated, count, counts_of, rows_of

TARGET = KEPT = Path(__file__).parents[2] / "outputs" / "real"
OWN, WITHIN = "own pixel", "within one pixel"
SAMPLED_WINDOWS, SAMPLED_PIXELS = 120, 12_000  # of each log, to which maps are fitted
BATCH = 16  # windows that are predicted together
Networks = dict[str, dict[Path, Predictor]]  # by name, the network that is tested with each log


def on_one_thread(function: Callable[..., Any], *values: Any) -> Any:
    """Call a function on one thread, in one of several processes."""
    with one_thread():
        return function(*values)


def sample(path: Path, predictor: Predictor) -> Sample:
    """Draw pixels of evenly spaced windows of a log, which all count alike, as when maps are compared."""
    rng = np.random.default_rng(0)
    every = list(cases_of(path, predictor))
    cases = [every[number] for number in np.unique(np.linspace(0, len(every) - 1, SAMPLED_WINDOWS).astype(int))]
    known = np.array([len(case.pixels) for case in cases])
    drawn = min(SAMPLED_PIXELS / known.sum(), 1.0)
    features, free = [], []
    for case in cases:
        chosen = rng.random(len(case.pixels)) < drawn
        features.append(case.evidence(predictor.grid).features(case.pixels[chosen]))
        free.append(case.free[chosen])
    return Sample(np.concatenate(features), np.concatenate(free))


def fitted_by_fold(paths: list[Path], predictor: Predictor) -> tuple[dict[int | None, Fitted], dict[str, Any]]:
    """Fit the maps without a network to the logs outside of each fold; return them and the chosen settings.

    Those for floors, of no fold, are fitted to all logs.
    """
    floors, paths = ([path for path in paths if is_floor(path) == which] for which in (True, False))
    with process_pool(count_cores()) as pool:
        samples = dict(zip(paths, pool(delayed(on_one_thread)(sample, path, predictor) for path in paths), strict=True))
    found, chosen = dict[int | None, Fitted](), dict[str, Any]()
    for fold in [*range(FOLDS), *([None] if floors else [])]:
        others = [path for path in paths if fold_of(path) != fold]
        of_places: dict[str, list[Sample]] = defaultdict(list)
        for path in others:
            if path.name in DEVELOPMENT:
                of_places[place_of(path)].append(samples[path])
        settings = maps.tuned(of_places) if len(of_places) > 1 else dict(maps.CANDIDATES[0])
        found[fold] = maps.fit([samples[path] for path in others], settings)
        title = "floors" if fold is None else f"fold {fold}"
        chosen[title] = {"constants": found[fold].constants, "boosting": settings}
    return found, chosen


def predictions(batch: tuple[Case, ...], predictor: Predictor) -> np.ndarray:
    """Predict the maps of some windows of one log as a user does, (B, H, W)."""
    limited = predictor.with_range(batch[0].range_max_m)
    return limited.predict(Scans.stack([case.window.scans for case in batch]), allow_empty=True)


@dataclass(frozen=True)
class Compared:
    """What held-out beams say of the maps of a log.

    Args:
        groups: the kinds of pixels, G.
        counts: counts of pixels by score and map, (blocks, G, 2, 256).
        ranked: AUROC of the first network in each window.
    """

    groups: tuple[str, ...]
    counts: dict[str, dict[str, np.ndarray]]
    ranked: list[float]


def compare(path: Path, networks: dict[str, Predictor], fitted: Fitted) -> Compared:
    """Compare all maps of a log with the held-out beams."""
    counts: dict[str, dict[str, dict[int, np.ndarray]]] = defaultdict(lambda: defaultdict(dict))
    names, ranked = tuple[str, ...](), list[float]()
    predictors = {name: fast(network) for name, network in networks.items()}
    grid = next(iter(predictors.values())).grid
    cases = iter(tqdm(cases_of(path, next(iter(predictors.values()))), desc=path.name, disable=None))
    for batch in iter(lambda: tuple(islice(cases, BATCH)), ()):
        images = {name: predictions(batch, predictor) for name, predictor in predictors.items()}
        for number, case in enumerate(batch):
            beside = around(case.pixels, grid.size_px)
            pixels, place = np.unique(beside, return_inverse=True)
            evidence = case.evidence(grid)
            free = {name: each[number].ravel()[pixels] for name, each in images.items()}
            free |= fitted.predict(evidence, pixels)
            free[maps.MIXED] = maps.mixed(free[next(iter(networks))], free[maps.BOOSTING])
            groups = case.groups(evidence.seen.ravel()[case.pixels])
            for name, each in free.items():
                levels = np.rint((LEVELS - 1) * each).astype(np.int64)[place.reshape(beside.shape)]
                for score, own in ((OWN, levels[:, 4]), (WITHIN, levels.min(1))):
                    before = counts[score][name].get(case.block, 0)
                    counts[score][name][case.block] = before + count(own, list(groups.values()), case.pixels)
                if name == next(iter(networks)):
                    ranked.append(float(auroc(counts_of(levels[:, 4], case.free))))
            names = tuple(groups)
    stacked = {
        score: {name: np.stack(list(blocks.values())) for name, blocks in of_maps.items()}
        for score, of_maps in counts.items()
    }
    return Compared(names, stacked, ranked)


def fast(predictor: Predictor) -> Predictor:
    """Return the same predictor with faster kernels."""
    network = copy.deepcopy(module_of(predictor))
    accelerate(network, "cpu")
    return replace(predictor, network=TorchNetwork(network))


def rows_of_kind(
    paths: list[Path], compared: dict[Path, Compared], reference: str, kind: str
) -> Iterator[dict[str, Any]]:
    """Yield the rows of logs of driving robots, of standing lidars, or of floors, by score."""
    own = [path for path in paths if kind_of(path) == kind]
    for score in (OWN, WITHIN):
        measured: dict[str, dict[str, Measured]] = defaultdict(dict)
        for path in own:
            for name, each in compared[path].counts[score].items():
                others = [compared[other] for other in paths if place_of(other) != place_of(path)]
                shares = [_share(other.counts[score][name]) for other in others]
                probability = calibrated(np.sum(shares, 0)) if score == WITHIN and shares else PROBABILITY
                measured[name][path.name] = Measured(len(compared[path].ranked), each, probability)
        about = {"robot": kind, "score": score}
        for row in rows_of(measured, compared[own[0]].groups, reference, sets_of(own)):
            yield about | row


def _share(counts: np.ndarray) -> np.ndarray:
    """Return the pixels of a log in each level as if there were a million, of the first kind, all pixels, (2, 256)."""
    total = counts[:, 0].sum(0)
    return 1e6 * total / total.sum()


def sets_of(paths: list[Path]) -> dict[str, list[str]]:
    """Return the logs over which is averaged: of all places that have one, and of those besides development."""
    names = [path.name for path in paths]
    if kind_of(paths[0]) != "drives":
        return {f"all {len(names)}": names}
    carmen = [name for name in names if name.endswith(".gz")]
    unused = [name for name in carmen if name not in DEVELOPMENT]
    sets = {f"CARMEN, all {len(carmen)}": carmen}
    if len(unused) < len(carmen):
        sets[f"CARMEN, the {len(unused)} besides development"] = unused
    sets["Wean Hall"] = [name for name in names if name not in carmen]
    return {title: found for title, found in sets.items() if found}


def main() -> None:
    """Compare all maps with all logs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, help="logs, and directories of floors")
    parser.add_argument("--adapted", help="weights, which are adapted to other logs than the tested ones")
    parser.add_argument("--weights", nargs="*", default=[], help="weights, which are tested as they are")
    parser.add_argument("--target", type=Path, default=TARGET)
    parser.add_argument("--kept", type=Path, default=KEPT, help="adapted networks")
    parser.add_argument("--all", action="store_true", help="also adapt the network to all logs")
    options = parser.parse_args()
    check(options.logs, [name for name in (options.adapted, *options.weights) if name])
    origin = environment()  # before the results change the working tree
    networks: Networks = {}
    if options.adapted:
        with one_thread():
            if options.all:
                adapted_to_all(options.adapted, options.logs, options.kept)
            networks[f"{options.adapted}, adapted"] = adapted(options.adapted, options.logs, options.kept)
    networks |= {name: dict.fromkeys(options.logs, load_trained(name)) for name in options.weights}
    reference = next(iter(networks.values()))[options.logs[0]]
    rows = list[dict[str, Any]]()
    with one_thread():
        by_fold, chosen = fitted_by_fold(options.logs, reference)
        fitted = {path: by_fold[fold_of(path)] for path in options.logs}
        tested = {path: {name: of_log[path] for name, of_log in networks.items()} for path in options.logs}
        with process_pool(count_cores()) as pool:
            every = pool(delayed(on_one_thread)(compare, path, tested[path], fitted[path]) for path in options.logs)
        compared = dict(zip(options.logs, every, strict=True))
        for kind in sorted(set(map(kind_of, options.logs))):
            rows += rows_of_kind(options.logs, compared, next(iter(networks)), kind)
        options.target.mkdir(parents=True, exist_ok=True)
        ranked = {path: each.ranked for path, each in compared.items() if not is_floor(path)}
        draw(ranked, next(iter(networks.values())), fitted).savefig(options.target / "windows.png", dpi=110)
    write(rows, chosen, options, origin)


def write(rows: list[dict[str, Any]], chosen: dict[str, Any], options: argparse.Namespace, origin: Any) -> None:
    """Write the rows with their origin, and print the means."""
    table = pd.DataFrame(rows)
    write_text(options.target / "held_out.csv", table.to_csv(index=False, float_format="%.4f"))
    checksums = {path.name: sha256(path / PLAN if is_floor(path) else path) for path in options.logs}
    write_json(options.target / "provenance.json", {"logs": checksums, "chosen": chosen, **origin})
    shown = ["robot", "score", "logs", "map", "pixels", "log_loss", "auroc", "less_log_loss", "less_log_loss_low"]
    print(table.loc[table["count"] > 1, [*shown, "less_log_loss_high"]].to_string())


if __name__ == "__main__":
    reported(main)
