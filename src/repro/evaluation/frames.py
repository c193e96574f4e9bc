"""Analysis of evaluated runs beyond the main tables, as tidy frames.

For every cell (experiment, model, encoding with or without decay) and all of its seeds: confidence intervals, errors by
recency and by obstacle, calibration, cost. Recordings and run directories in, frames out.
"""

import dataclasses
import itertools
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd

from repro.baselines.titles import rank
from repro.evaluation.breakdown import TestSet, by_last_hit, by_recency, load_test_set
from repro.evaluation.recency import RECENCY
from repro.evaluation.scoring import read_per_image, read_quantized
from repro.learning.networks.create import create_network
from repro.metrics.bootstrap import Measured, by_world, draw_weights, intervals, resample
from repro.metrics.calibration import reliability, summary
from repro.metrics.counts import count_quantized
from repro.recordings.datasets import encoding_of, grid_of
from repro.recordings.reader import open_recordings
from repro.runs.config import NO_DECAY
from repro.runs.directories import Run
from repro.runs.keys import CELL
from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs
from repro.system.errors import InputError
from repro.system.progress import progress

ANALYZED = ("intervals", "recency", "obstacles", "calibration", "reliability", "cost")  # tables of `gather`
Cell = tuple[str, str, str]  # experiment, model, encoding
FEWER_DRAWS = 501  # rows of the bootstrap weights for measures by recency and by last hit


def gather(outputs: Outputs, parallel: joblib.Parallel | None = None) -> dict[str, pd.DataFrame]:
    """Gather the analysis of all evaluated runs below an outputs directory.

    Args:
        outputs: an outputs directory with its runs and recordings.
        parallel: processes, of which each takes an experiment at a time; None computes in this process.

    Returns:
        the tables of `ANALYZED`, each a tidy frame; empty if no run is evaluated.

    Raises:
        InputError: a recording or a run is damaged.
    """
    by_experiment: dict[str, dict[Cell, list[Run]]] = defaultdict(dict)
    for cell, runs in _cells(outputs).items():
        by_experiment[cell[0]][cell] = runs
    jobs = [
        joblib.delayed(_measure)(outputs.recordings(name), by_experiment[name], name) for name in sorted(by_experiment)
    ]
    tables: dict[str, list[pd.DataFrame]] = defaultdict(list)
    for name, frame in itertools.chain.from_iterable((parallel or joblib.Parallel(1))(jobs)):
        tables[name].append(frame)
    return {name: pd.concat(frames, ignore_index=True) for name, frames in tables.items()}


def _measure(recordings: Path, cells: dict[Cell, list[Run]], experiment: str) -> list[tuple[str, pd.DataFrame]]:
    """Return the frames of the cells of an experiment by the names of their tables, of which one may have several."""
    test = load_test_set(open_recordings(recordings), grid_of(next(iter(cells.values()))[0].config()))
    weights = draw_weights(len(test.truth) // 2)
    counted: dict[Cell, Measured] = {}
    found = []
    for cell, runs in progress(cells.items(), f"analysis, exp {experiment}"):
        counted[cell], frames = _measure_cell(runs, test, weights)
        found += [(name, _identified(frame, _columns(cell))) for name, frame in frames.items()]
    seeds = {cell: [run.config().seed for run in runs] for cell, runs in cells.items()}
    for cell, table, common in averages(counted, seeds, weights):
        rows = pd.DataFrame(intervals(table)).assign(seeds=common)
        found.append(("intervals", _identified(rows, _columns(cell))))
    return found


def _identified(rows: pd.DataFrame, columns: dict[str, Any]) -> pd.DataFrame:
    """Return rows with constant columns, which identify them, before their own."""
    return pd.DataFrame({**{name: [value] * len(rows) for name, value in columns.items()}, **rows})


def _columns(cell: Cell) -> dict[str, Any]:
    return dict(zip(CELL, cell, strict=True))


def _cells(outputs: Outputs) -> dict[Cell, list[Run]]:
    """Return the evaluated runs of each cell, in the order of the tables."""
    cells: dict[Cell, list[Run]] = defaultdict(list)
    for run in outputs.runs():
        if run.is_evaluated:
            key = run.config().key
            cells[key.experiment, key.model, key.encoding].append(run)
    return dict(sorted(cells.items(), key=lambda item: (item[0][0], item[0][2].endswith(NO_DECAY), rank(item[0][1]))))


def _read_run(run: Run, test: TestSet) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read the quantized predictions, (M, H, W), and the metrics of images, each (M,), of a run on the test set."""
    free, of_images = read_quantized(run), read_per_image(run)
    images = len(of_images["ssim"])
    if free.shape != test.truth.shape or images != len(free):
        raise InputError(
            f"{run} has predictions of shape {free.shape} and {images} SSIM values for test maps of shape "
            f"{test.truth.shape}: {run.evaluate_again}"
        )
    return free, of_images


def _measure_cell(runs: list[Run], test: TestSet, weights: np.ndarray) -> tuple[Measured, dict[str, pd.DataFrame]]:
    """Measure all seeds of a cell; for the weights of the bootstrap see `metrics.bootstrap.draw_weights`.

    Returns:
        counts and metrics of images of its seeds; its rows by the name of their table.
    """
    few_weights = weights[:FEWER_DRAWS]
    predictions, of_images = zip(*(_read_run(run, test) for run in runs), strict=True)
    counts = np.stack([by_world(count_quantized(free, test.truth, test.groups, len(RECENCY))) for free in predictions])
    names = of_images[0]
    per_world = {name: np.stack([by_world(of_seed[name]) / 2 for of_seed in of_images]) for name in names}
    measured = Measured(counts.sum(2), per_world)
    frames = {
        "intervals": pd.DataFrame(intervals(resample(measured, weights))).assign(seeds=len(runs)),
        "recency": by_recency(counts.sum(0), few_weights),
        "obstacles": by_last_hit(predictions, test, few_weights),
    }
    if not runs[0].config().key.is_baseline:
        frames["cost"] = _cost(runs)
        frames["calibration"] = _calibration(counts.sum(1))
        frames["reliability"] = _reliability(counts.sum((0, 1)))
    return measured, frames


def _cost(runs: list[Run]) -> pd.DataFrame:
    """Return the cost of a cell: network parameters and input channels, mean time and peak memory of a training."""
    runs[0].check_files()
    names, config = ("training_seconds", "peak_memory_gb"), runs[0].config()
    facts = pd.DataFrame([{name: run.provenance().fact(name) for name in names} for run in runs], dtype=float)
    encoding, untrained = encoding_of(config), dataclasses.replace(config.model, encoder_weights=None)
    network = create_network(untrained, encoding.channels, encoding.frames)
    parameters = sum(weights.numel() for weights in network.parameters())
    return pd.DataFrame([{"parameters": parameters, "channels": encoding.channels, **facts.mean()}])


def _calibration(counts: np.ndarray) -> pd.DataFrame:
    """Measure the calibration over all pixels, averaged over seeds, and of each recency, from (S, G, 2, 256)."""
    all_pixels = pd.DataFrame([summary(own) for own in counts.sum(1)]).mean().to_frame().T.assign(recency="all")
    by_name = zip(RECENCY, counts.sum(0), strict=True)
    others = [{"recency": name, **summary(own)} for name, own in by_name if own[0].sum()]
    return pd.concat([all_pixels, pd.DataFrame(others)], ignore_index=True)


def _reliability(counts: np.ndarray) -> pd.DataFrame:
    """Return the reliability diagram of all pixels and of each recency that has some, from counts (G, 2, 256)."""
    pooled = {"all": counts.sum(0), **{name: own for name, own in zip(RECENCY, counts, strict=True) if own.sum()}}
    return pd.concat(
        [pd.DataFrame({**vars(reliability(own)), "recency": name}) for name, own in pooled.items()], ignore_index=True
    )


def averages(
    counted: dict[Cell, Measured], seeds: dict[Cell, list[int | None]], weights: np.ndarray
) -> Iterator[tuple[Cell, dict[str, np.ndarray], int]]:
    """Yield the mean of the paper's networks in every draw, for each encoding on which all of them are evaluated.

    It is taken over the seeds that all four have, as in the tables; the last value is their number.
    """
    for experiment, encoding in dict.fromkeys((cell[0], cell[2]) for cell in counted):
        cells: list[Cell] = [(experiment, name, encoding) for name in NETWORKS]
        if not all(cell in counted for cell in cells):
            continue
        common = [seed for seed in seeds[cells[0]] if all(seed in seeds[cell] for cell in cells)]
        if not common:
            continue
        draws = []
        for cell in cells:
            chosen = [seeds[cell].index(seed) for seed in common]
            per_world = {name: values[chosen] for name, values in counted[cell].per_world.items()}
            draws.append(resample(Measured(counted[cell].counts[chosen], per_world), weights))
        yield (
            (experiment, "average", encoding),
            {name: np.mean([of_network[name] for of_network in draws], axis=0) for name in draws[0]},
            len(common),
        )
