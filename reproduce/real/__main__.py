"""Compare networks and maps without a network with logs of real lidars.

    python -m reproduce.real LOG [LOG ...] [--target DIRECTORY] [--folds FOLDS]

A part of the beams is kept from all maps, see `repro.learning.held_out`; at the end of every window, the maps are
compared with the pixels that these beams hit or passed over. Whatever a map without a network fits is from the other
logs of its kind. The rows go to held_out.csv in the target, their origin to provenance.json. Maps of networks are kept
in --kept, so that a comparison which was stopped goes on, and a changed map without a network takes minutes.

With --folds, the networks are adapted to logs, as task=adapt does, and tested on logs of another fold. Only their
calibration has seen the tested log, by the networks of other folds; `network, uncalibrated` has seen nothing of it.

The published rows are of the gzipped CARMEN logs with poses corrected by a scan matcher of the Robotics Data Set
Repository (Radish), https://github.com/acschaefer/ple/tree/master/data/carmen, see also
https://www.ipb.uni-bonn.de/datasets, and of bags of a standing lidar among people (BSD-3),
https://github.com/angusleigh/leg_tracker/tree/melodic/rosbags/training/scans_res_0_33/positive_not_extracted.
"""

import argparse
import copy
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from repro.learning import held_out
from repro.learning.kernels import accelerate
from repro.learning.networks.trained import TorchNetwork, load_trained, module_of
from repro.metrics.counts import LEVELS
from repro.networks.predictor import Predictor
from repro.runs.devices import one_thread
from repro.runs.provenance import environment
from repro.scans import Scans
from repro.system.arrays import open_arrays
from repro.system.files import sha256, write_json, write_text
from reproduce.real import logs
from reproduce.real.adapted import adapted, adapted_to, labels_of
from reproduce.real.evidence import CENTER, evidence_at, join
from reproduce.real.figure import choose, draw
from reproduce.real.fitting import NETWORK, UNCALIBRATED, Fitted, Sample, fit_others, maps_of
from reproduce.real.logs import cases_of, is_standing
from reproduce.real.measures import MEAN, Measured, count, neighbors, rows_of

RESULTS = Path(__file__).parents[1] / "results"
TARGET, KEPT = RESULTS / "robot_logs", RESULTS.parents[1] / "outputs" / "real"
WEIGHTS = (
    *("rooms-16000/exppeople-convgru", "places/exppeople-convgru"),
    *("drive-16000/expmixed-convgru", "workstation/exp4-unet"),
)
SAMPLED_WINDOWS, SAMPLED_PIXELS = 100, 100  # of each log, the latter of each window, to which maps are fitted
BATCH = 16  # windows that are predicted together


def predictions(path: Path, predictor: Predictor, origin: dict[str, str], kept: Path) -> np.ndarray:
    """Return the levels of a network at the compared pixels of all windows, the lowest within one pixel, (P,).

    Args:
        path: the log.
        predictor: the network.
        origin: checksums of log and network, and of the code that cuts windows.
        kept: the file from which they are read, or to which they are written.
    """
    if kept.is_file():
        with open_arrays(kept) as content:
            if all(str(content.get(name)) == value for name, value in origin.items()):
                return np.rint((LEVELS - 1) * content["free"]).astype(np.int64)
    free, cases = [], list(cases_of(path, predictor))
    network = copy.deepcopy(module_of(predictor))
    accelerate(network, "cpu")
    predictor = replace(predictor, network=TorchNetwork(network))
    for first in tqdm(range(0, len(cases), BATCH), desc=f"{path.name}, network", disable=None):
        batch = cases[first : first + BATCH]
        limited = predictor.with_range(batch[0].range_max_m)
        images = limited.predict(Scans.stack([case.window.scans for case in batch]), allow_empty=True)
        for case, image in zip(batch, images, strict=True):
            free.append(image.ravel()[neighbors(case.pixels, len(image))].min(1))
    kept.parent.mkdir(parents=True, exist_ok=True)
    np.savez(kept, free=np.concatenate(free), **origin)  # type: ignore[arg-type]
    return np.rint((LEVELS - 1) * np.concatenate(free)).astype(np.int64)


def sample(path: Path, predictor: Predictor, network: np.ndarray) -> Sample:
    """Draw pixels of evenly spaced windows of a log, given the levels of the network at all compared pixels."""
    rng = np.random.default_rng(0)
    cases = list(cases_of(path, predictor))
    first = np.cumsum([0, *(len(case.pixels) for case in cases)])
    evidence, levels, free = [], [], []
    for number in np.unique(np.linspace(0, len(cases) - 1, SAMPLED_WINDOWS).astype(int)):
        case = cases[number]
        chosen = np.sort(rng.permutation(len(case.pixels))[:SAMPLED_PIXELS])
        evidence.append(evidence_at(case, predictor.grid, case.pixels[chosen]))
        levels.append(network[first[number] + chosen])
        free.append(case.free[chosen])
    return Sample(join(evidence), np.concatenate(levels), np.concatenate(free))


def compare(
    path: Path, predictor: Predictor, network: np.ndarray, fitted: Fitted
) -> tuple[tuple[str, ...], dict[str, Measured]]:
    """Compare all maps of a log with the held-out beams; return the kinds of pixels and what is measured by map."""
    counts: dict[str, dict[int, np.ndarray]] = defaultdict(dict)
    first, windows = 0, 0
    names: tuple[str, ...] = ()
    for case in tqdm(cases_of(path, predictor), desc=path.name, disable=None):
        pixels = case.pixels
        evidence = evidence_at(case, predictor.grid, pixels)
        of_network = np.broadcast_to(network[first : first + len(pixels), None], (len(pixels), 9))
        groups = case.groups(evidence.seen[:, CENTER])
        levels = {NETWORK: of_network, UNCALIBRATED: of_network, **maps_of(evidence, fitted)}
        for name, each in levels.items():
            before = counts[name].get(case.block, 0)
            counts[name][case.block] = before + count(each, list(groups.values()), pixels)
        first, names, windows = first + len(pixels), tuple(groups), windows + 1
    assert first == len(network), "the predictions are those of the same windows"
    measured = {
        name: Measured(windows, np.stack(list(blocks.values())), fitted.probability[name])
        for name, blocks in counts.items()
    }
    return names, measured


def origin_of(weights: str) -> dict[str, str]:
    """Return the checksums of a network, and of the code that cuts and labels windows."""
    code = {module.__name__: sha256(Path(str(module.__file__))) for module in (logs, held_out)}
    return {"weights": sha256(RESULTS / weights / "model.safetensors")} | code


def compare_all(
    paths: list[Path], weights: str, kept: Path, folds: int = 0, figure: Path | None = None
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Compare all maps of all logs; return the rows of the table and the chosen constants by log.

    Args:
        paths: the logs.
        weights: the network.
        kept: the directory of maps and adapted networks.
        folds: the network is adapted to the logs of all folds but one, if there are any.
        figure: the file of five windows; None for none.
    """
    predictor = load_trained(RESULTS / weights)
    origin = origin_of(weights)
    checksums, of_log = {path: sha256(path) for path in paths}, dict.fromkeys(paths, predictor)
    if folds:
        kept, weights = kept / f"adapted-{folds}", f"{weights}, adapted"
        of_log = adapted(predictor, origin, checksums, kept, folds)
        origin |= {"adapted_to": " ".join(checksums.values())}
    levels: dict[Path, np.ndarray] = {}
    fitted: dict[str, Fitted] = {}
    rows: list[dict[str, Any]] = []
    for path in paths:
        maps = kept / weights / f"{path.name}.npz"
        levels[path] = predictions(path, of_log[path], {"log": checksums[path], **origin}, maps)
    for stands in sorted(set(map(is_standing, paths))):
        kind = [path for path in paths if is_standing(path) == stands]
        samples = {path.name: sample(path, predictor, levels[path]) for path in kind}
        fitted |= {path.name: fit_others(samples, path.name) for path in kind}
        about = {"weights": weights, "robot": "stands" if stands else "drives"}
        rows += [about | row for row in compare_kind(kind, predictor, levels, fitted)]
    if figure:
        draw(choose(levels, predictor), of_log, fitted).savefig(figure, dpi=110)
    return rows, {name: each.constants for name, each in fitted.items()}


def compare_kind(
    paths: list[Path], predictor: Predictor, levels: dict[Path, np.ndarray], fitted: dict[str, Fitted]
) -> Iterator[dict[str, Any]]:
    """Return the rows of logs of driving robots or of those of standing lidars, given the levels of the network."""
    maps: dict[str, dict[str, Measured]] = defaultdict(dict)
    groups = tuple[str, ...]()
    for path in paths:
        groups, measured = compare(path, predictor, levels[path], fitted[path.name])
        for name, each in measured.items():
            maps[name][path.name] = each
    return rows_of(maps, groups, NETWORK)


def main() -> None:
    """Compare all networks with all logs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--weights", nargs="+", default=WEIGHTS, help="directories below reproduce/results")
    parser.add_argument("--target", type=Path, default=TARGET)
    parser.add_argument("--kept", type=Path, default=KEPT)
    parser.add_argument("--folds", type=int, default=0, help="adapt the networks to the logs of all folds but one")
    parser.add_argument("--save", type=Path, help="only adapt the first network to all logs, below this directory")
    options = parser.parse_args()
    if options.save:
        checksums = {path: sha256(path) for path in options.logs}
        predictor, origin = load_trained(RESULTS / options.weights[0]), origin_of(options.weights[0])
        adapted_to(predictor, origin, checksums, labels_of(predictor, options.logs), options.save)
        return
    origin = environment()  # before the results change the working tree
    options.target.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    constants: dict[str, Any] = {}
    with one_thread():
        for weights in options.weights:
            figure = options.target / "windows.png" if weights == options.weights[0] else None
            of_weights, chosen = compare_all(options.logs, weights, options.kept, options.folds, figure)
            rows += of_weights
            constants[of_weights[0]["weights"]] = chosen
            write(rows, constants, options, origin)


def write(rows: list[dict[str, Any]], constants: dict[str, Any], options: argparse.Namespace, origin: Any) -> None:
    """Write the rows so far, means first, with their origin, and print the means."""
    table = pd.DataFrame(rows)
    table = table.sort_values("log", key=lambda logs: logs != MEAN, kind="stable")
    write_text(options.target / "held_out.csv", table.to_csv(index=False, float_format="%.4f"))
    checksums = {path.name: sha256(path) for path in options.logs}
    write_json(options.target / "provenance.json", {"logs": checksums, "constants": constants, **origin})
    shown = ["weights", "robot", "map", "pixels", "auroc", "less_auroc", "less_auroc_low", "less_auroc_high"]
    print(table.loc[table["log"] == MEAN, shown].to_string())


if __name__ == "__main__":
    main()
