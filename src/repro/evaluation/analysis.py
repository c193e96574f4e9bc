"""Analysis of evaluated runs beyond the main tables, as tidy frames.

For every cell (experiment, model, encoding with or without decay) and all of its seeds: confidence intervals,
differences between cells, errors by recency and by obstacle, calibration, cost. Recordings and run directories in,
frames out.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from repro.baselines.names import rank
from repro.config import NO_DECAY
from repro.evaluation.breakdown import TestSet, by_age, by_last_hit, by_recency, load_test_set, uncertainty
from repro.evaluation.comparisons import Cell, averages, differences
from repro.evaluation.evaluate import read_quantized, read_ssim, validation_quantized
from repro.evaluation.recency import GROUPS, RECENCY
from repro.maps.datasets import grid_of
from repro.metrics.bootstrap import Measured, by_world, draw_weights, interval, resample
from repro.metrics.calibration import fit_temperature, reliability, summary, temperature_scaled
from repro.metrics.counts import count_quantized, pooled_scores
from repro.metrics.names import SUMMARY
from repro.networks.predictor import load_predictor
from repro.runs.directories import Outputs, Run
from repro.runs.keys import CELL
from repro.system.errors import is_about_input

FEWER_DRAWS = 501  # rows of the bootstrap weights for measures by recency and by last hit


@dataclass
class Analysis:
    """Tidy rows by the name of the CSV file they are written to."""

    rows: dict[str, list[pd.DataFrame]] = field(default_factory=lambda: defaultdict(list))

    def add(self, name: str, frame: pd.DataFrame, columns: dict[str, Any]) -> None:
        """Add rows with constant columns, which identify them, before their own."""
        self.rows[name].append(
            pd.DataFrame({**{name: [value] * len(frame) for name, value in columns.items()}, **frame})
        )

    def take(self, other: "Analysis") -> None:
        """Add all rows of another analysis."""
        for name, rows in other.rows.items():
            self.rows[name].extend(rows)

    def frames(self) -> dict[str, pd.DataFrame]:
        return {name: pd.concat(rows, ignore_index=True) for name, rows in self.rows.items()}


def gather(outputs: Outputs, errors: list[str] | None = None, *, accelerator: str = "auto") -> dict[str, pd.DataFrame]:
    """Gather the analysis of all evaluated runs below an outputs directory.

    Args:
        outputs: an outputs directory with its runs and recordings.
        errors: receives the message of every damaged run, whose cell is left out; None raises at the first damaged run.
        accelerator: auto, cpu or gpu, for the predictions of the validation set.

    Returns:
        intervals, differences, recency, ages, obstacles, uncertainty (of cells with several seeds), calibration,
        reliability and cost, each a tidy frame; empty if no run is evaluated.

    Raises:
        ValueError: a recording is damaged, or a run is and `errors` is None, or no network can be analyzed.
    """
    analysis, cells = Analysis(), _cells(outputs, errors)
    for experiment in sorted({experiment for experiment, *_ in cells}):
        own_cells = {cell: runs for cell, runs in cells.items() if cell[0] == experiment}
        recordings, config = outputs.recordings(experiment), next(iter(own_cells.values()))[0].config()
        test = load_test_set(recordings, grid_of(config))
        weights = draw_weights(len(test.truth) // 2)
        draws: dict[Cell, pd.DataFrame] = {}
        counted: dict[Cell, Measured] = {}
        for cell, runs in tqdm(own_cells.items(), desc=f"analysis, exp {experiment}", leave=False, disable=None):
            try:
                measured = [_read_run(run, test) for run in runs]
                own = Analysis()  # its rows are taken once the whole cell is measured
                measures, drawn = _measure_cell(
                    own, _columns(cell), runs, measured, recordings, test, weights, accelerator
                )
            except ValueError as error:
                if errors is None or not is_about_input(error):
                    raise
                errors.append(str(error))
                continue
            analysis.take(own)
            counted[cell], draws[cell] = measures, drawn
        seeds = {cell: [run.config().seed for run in runs] for cell, runs in own_cells.items()}
        for cell, table in averages(counted, seeds, weights):
            draws[cell] = table
            analysis.add("intervals", interval(table), _columns(cell))
        for rows, columns in differences(draws):
            analysis.add("differences", rows, columns)
    if errors and "calibration" not in analysis.rows:
        raise ValueError(f"no run can be analyzed: {errors[0]}")
    return analysis.frames()


def _columns(cell: Cell) -> dict[str, Any]:
    return dict(zip(CELL, cell, strict=True))


def _cells(outputs: Outputs, errors: list[str] | None) -> dict[Cell, list[Run]]:
    """Return the evaluated runs of each cell, in the order of the tables; copies of other runs are left out."""
    cells: dict[Cell, list[Run]] = defaultdict(list)
    for run in outputs.runs():
        try:
            key = run.config().key if run.is_evaluated else None
        except ValueError as error:
            if errors is None:
                raise
            errors.append(str(error))
            continue
        if key and outputs.run(key) == run:
            cells[key.experiment, key.model, key.encoding].append(run)
    return dict(sorted(cells.items(), key=lambda item: (item[0][0], item[0][2].endswith(NO_DECAY), rank(item[0][1]))))


def _read_run(run: Run, test: TestSet) -> tuple[np.ndarray, np.ndarray]:
    """Read the quantized predictions, (M, H, W), and the SSIM, (M,), of a run on the test set."""
    free, ssim = read_quantized(run), read_ssim(run)
    if free.shape != test.truth.shape or len(ssim) != len(free):
        raise ValueError(
            f"{run} has predictions of shape {free.shape} and {len(ssim)} SSIM values for test maps of shape "
            f"{test.truth.shape}: delete {run.metrics} and run the same command with task=evaluate"
        )
    return free, ssim


def _measure_cell(
    analysis: Analysis,
    columns: dict[str, Any],
    runs: list[Run],
    measured: list[tuple[np.ndarray, np.ndarray]],
    recordings: Path,
    test: TestSet,
    weights: np.ndarray,
    accelerator: str,
) -> tuple[Measured, pd.DataFrame]:
    """Measure all seeds of a cell; return its counts and SSIM, and its metrics in every draw of the bootstrap."""
    predictions = [free for free, _ in measured]
    counts = np.stack([by_world(count_quantized(free, test.truth, test.groups, GROUPS)) for free in predictions])
    ssim = np.stack([by_world(values) / 2 for _, values in measured])
    measures = Measured(counts.sum(2), ssim)
    drawn = resample(measures, weights)
    analysis.add("intervals", interval(drawn).assign(seeds=len(runs)), columns)
    pooled = counts.sum((0, 1))  # (G, 2, 256)
    recency = {name: pooled[list(groups)].sum(0) for name, groups in RECENCY.items()}
    analysis.add("recency", by_recency(counts.sum(0), weights[:FEWER_DRAWS]), columns)
    analysis.add("ages", by_age(pooled), columns)
    if len(runs) > 1:
        analysis.add("uncertainty", uncertainty(predictions, test.groups), columns)
    analysis.add("obstacles", by_last_hit(predictions, test, weights[:FEWER_DRAWS]), columns)
    if runs[0].model.is_dir():
        analysis.add("cost", _cost(runs), columns)
        validation = [validation_quantized(run, recordings, accelerator=accelerator) for run in runs]
        _calibrate(analysis, columns, validation, counts.sum((1, 2)), recency, predictions, test.truth)
    return measures, drawn


def _cost(runs: list[Run]) -> pd.DataFrame:
    """Return the cost of a cell: network parameters and input channels, mean time and peak memory of a training."""
    predictor = load_predictor(runs[0].model)
    facts = {name: [run.provenance().fact(name) for run in runs] for name in ("training_seconds", "peak_memory_gb")}
    row = {
        "parameters": sum(each.numel() for each in predictor.network.parameters()),
        "channels": predictor.encoding.channels,
        **{name: pd.Series(values, dtype=float).mean() for name, values in facts.items()},
    }
    return pd.DataFrame([row])


def _calibrate(
    analysis: Analysis,
    columns: dict[str, Any],
    validation: list[tuple[np.ndarray, np.ndarray]],
    each: np.ndarray,
    recency: dict[str, np.ndarray],
    predictions: list[np.ndarray],
    truth: np.ndarray,
) -> None:
    """Measure calibration: uncalibrated, temperature-scaled (fitted on validation data), and of the mean over seeds.

    `validation` has the quantized predictions and the true maps of the validation set for each seed, `each` the counts
    of each seed, (S, 2, 256), and `recency` those of all seeds together, (2, 256).
    """
    temperatures = [fit_temperature(count_quantized(free, true)[:, 0].sum(0)) for free, true in validation]
    rows = [{"method": "uncalibrated", "recency": "all", **_mean([summary(counts) for counts in each])}]
    scaled = [summary(c, temperature_scaled(t)) for c, t in zip(each, temperatures, strict=True)]
    rows.append(
        {"method": "temperature-scaled", "recency": "all", **_mean(scaled), "temperature": float(np.mean(temperatures))}
    )
    if len(predictions) > 1:
        mean = np.mean(predictions, axis=0).round().astype(np.uint8)
        counts = count_quantized(mean, truth)[:, 0].sum(0)
        score = {name: float(value) for name, value in pooled_scores(counts).items()}
        kept = {name: score[name] for name in SUMMARY}
        rows.append({"method": f"mean of {len(predictions)} seeds", "recency": "all", **summary(counts), **kept})
    rows += [{"method": "uncalibrated", "recency": n, **summary(c)} for n, c in recency.items() if c[0].sum()]
    analysis.add("calibration", pd.DataFrame(rows), columns)
    pooled = {"all": each.sum(0), **{name: counts for name, counts in recency.items() if counts.sum()}}
    for name, counts in pooled.items():
        analysis.add("reliability", reliability(counts).assign(recency=name), columns)


def _mean(rows: list[dict[str, float]]) -> dict[str, float]:
    return {str(name): value for name, value in pd.DataFrame(rows).mean().items()}
