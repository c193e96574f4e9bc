"""Evidence: what run directories and recordings say beyond the tables, as tidy frames.

For every cell (experiment, model, encoding with or without decay) and all of its seeds: intervals, differences, where
and when the errors are, calibration. Recordings in, run directories in, frames out.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from repro.config import LEARNED, NETWORKS
from repro.evaluation.breakdown import TestSet, by_age, by_last_hit, by_stratum, load_test_set
from repro.evaluation.calibration import fit_temperature, reliability, summary, tempered
from repro.evaluation.intervals import Measured, by_world, difference, draw_weights, interval, resample
from repro.evaluation.levels import count_levels, pooled_scores
from repro.evaluation.predictions import read_levels, read_ssim, validation_levels
from repro.evaluation.rivals import RIVALS
from repro.evaluation.strata import GROUPS, STRATA
from repro.maps.datasets import grid_of
from repro.prediction import load_predictor
from repro.runs import Outputs, Run

FEWER_DRAWS = 501  # for what is measured stratum by stratum
Key = dict[str, Any]  # experiment, model, encoding, decay


@dataclass
class Evidence:
    """Tidy rows, by name: what becomes <name>.csv."""

    rows: dict[str, list[pd.DataFrame]] = field(default_factory=lambda: defaultdict(list))

    def add(self, name: str, frame: pd.DataFrame, key: Key) -> None:
        """Adds rows, with the columns of a key before theirs."""
        self.rows[name].append(pd.DataFrame({**{k: [v] * len(frame) for k, v in key.items()}, **frame}))

    def frames(self) -> dict[str, pd.DataFrame]:
        return {name: pd.concat(rows, ignore_index=True) for name, rows in self.rows.items()}


def gather(outputs: Outputs) -> dict[str, pd.DataFrame]:
    """Gathers the evidence of all evaluated runs below an outputs directory.

    Args:
        outputs: an outputs directory with the recordings its runs were made from.

    Returns:
        intervals, differences, strata, ages, obstacles, calibration, reliability and cost, each a tidy frame. Empty
        when no network has been evaluated.

    Raises:
        ValueError: a run or a recording cannot be trusted.
    """
    evidence, cells = Evidence(), _cells(outputs)
    for experiment in sorted({experiment for experiment, *_ in cells}):
        mine = {key: runs for key, runs in cells.items() if key[0] == experiment}
        recordings, config = outputs.recordings(experiment), next(iter(mine.values()))[0].config()
        test = load_test_set(recordings, grid_of(config))
        weights = draw_weights(len(test.truth) // 2)
        drawn: dict[tuple, pd.DataFrame] = {}
        for cell, runs in tqdm(mine.items(), desc=f"evidence, exp {experiment}", leave=False, disable=None):
            drawn[cell] = _measure_cell(evidence, _key(cell), runs, recordings, test, weights)
        for cell, table in _averages(drawn):
            drawn[cell] = table
            evidence.add("intervals", interval(table), _key(cell))
        _compare_cells(evidence, drawn)
    return evidence.frames()


def _key(cell: tuple) -> Key:
    return dict(zip(("experiment", "model", "encoding", "decay"), cell, strict=True))


def _cells(outputs: Outputs) -> dict[tuple, list[Run]]:
    """Finds the evaluated runs of each cell, in the order of the tables."""
    cells: dict[tuple, list[Run]] = defaultdict(list)
    for run in outputs.runs():
        if run.is_evaluated:
            config = run.config()
            cells[config.experiment, config.model.name, config.encoding.name, config.encoding.decay].append(run)
    rank = {name: number for number, name in enumerate((*LEARNED, *RIVALS))}
    return dict(sorted(cells.items(), key=lambda item: (item[0][0], not item[0][3], rank.get(item[0][1], 99))))


def _measure_cell(
    evidence: Evidence, key: Key, runs: list[Run], recordings: Path, test: TestSet, weights: np.ndarray
) -> pd.DataFrame:
    """Measures all seeds of a cell; returns its metrics in every draw of the bootstrap."""
    levels = [read_levels(run) for run in runs]
    counts = np.stack([by_world(count_levels(free, test.truth, test.groups, GROUPS)) for free in levels])
    ssim = np.stack([by_world(read_ssim(run)) / 2 for run in runs])
    drawn = resample(Measured(counts.sum(2), ssim), weights)
    evidence.add("intervals", interval(drawn).assign(seeds=len(runs)), key)
    pooled = counts.sum((0, 1))  # (G, 2, 256)
    strata = {name: pooled[list(groups)].sum(0) for name, groups in STRATA.items()}
    evidence.add("strata", by_stratum(counts.sum(0), weights[:FEWER_DRAWS]), key)
    evidence.add("ages", by_age(pooled), key)
    evidence.add("obstacles", by_last_hit(levels, test, weights[:FEWER_DRAWS]), key)
    if runs[0].model.is_dir():
        evidence.add("cost", _cost(runs), key)
        _calibrate(evidence, key, runs, recordings, counts.sum((1, 2)), strata, levels, test.truth)
    return drawn


def _cost(runs: list[Run]) -> pd.DataFrame:
    """Says what a cell costs: parameters of its network, channels of its input; time and memory of a training."""
    predictor = load_predictor(runs[0].model)
    facts = {name: [run.provenance().fact(name) for run in runs] for name in ("training_seconds", "peak_memory_gb")}
    row = {
        "parameters": sum(each.numel() for each in predictor.network.parameters()),
        "channels": predictor.encoding.channels,
        **{name: pd.Series(values, dtype=float).mean() for name, values in facts.items()},
    }
    return pd.DataFrame([row])


def _calibrate(
    evidence: Evidence,
    key: Key,
    runs: list[Run],
    recordings: Path,
    each: np.ndarray,
    strata: dict[str, np.ndarray],
    levels: list[np.ndarray],
    truth: np.ndarray,
) -> None:
    """Measures calibration as it is, after temperature scaling fitted on validation data, and of the seeds' mean.

    `each` has the counts of each seed, (S, 2, 256), `strata` those of all seeds together, (2, 256).
    """
    validation = [validation_levels(run, recordings) for run in runs]
    temperatures = [fit_temperature(count_levels(free, true)[:, 0].sum(0)) for free, true in validation]
    rows = [{"what": "as it is", "stratum": "all", **_mean([summary(counts) for counts in each])}]
    scaled = [summary(c, tempered(t)) for c, t in zip(each, temperatures, strict=True)]
    rows.append({"what": "tempered", "stratum": "all", **_mean(scaled), "temperature": float(np.mean(temperatures))})
    if len(levels) > 1:
        mean = np.mean(levels, axis=0).round().astype(np.uint8)
        counts = count_levels(mean, truth)[:, 0].sum(0)
        score = {name: float(value) for name, value in pooled_scores(counts).items()}
        kept = {name: score[name] for name in ("accuracy", "specificity", "obstacle_iou")}
        rows.append({"what": f"mean of {len(levels)} seeds", "stratum": "all", **summary(counts), **kept})
    rows += [{"what": "as it is", "stratum": n, **summary(c)} for n, c in strata.items() if c[0].sum()]
    evidence.add("calibration", pd.DataFrame(rows), key)
    pooled = {"all": each.sum(0), **{name: counts for name, counts in strata.items() if counts.sum()}}
    for name, counts in pooled.items():
        evidence.add("reliability", reliability(counts).assign(stratum=name), key)


def _mean(rows: list[dict[str, float]]) -> dict[str, float]:
    return {str(name): value for name, value in pd.DataFrame(rows).mean().items()}


def _averages(drawn: dict[tuple, pd.DataFrame]) -> Iterator[tuple[tuple, pd.DataFrame]]:
    """Yields the mean of the four networks of each encoding that has them all, in every draw."""
    for experiment, encoding, decay in dict.fromkeys((key[0], key[2], key[3]) for key in drawn):
        networks = [drawn.get((experiment, name, encoding, decay)) for name in NETWORKS]
        whole = [table for table in networks if table is not None]
        if len(whole) == len(NETWORKS):
            yield (experiment, "average", encoding, decay), sum(whole[1:], whole[0]) / len(whole)


def _compare_cells(evidence: Evidence, drawn: dict[tuple, pd.DataFrame]) -> None:
    """Compares networks with one another, decay with none, and other encodings with the paper's."""
    for one, other in itertools.combinations(drawn, 2):
        (experiment, model, encoding, decay), (_, model2, encoding2, decay2) = one, other
        what = {
            (True, False, False): "networks",
            (False, True, False): "decay",
            (False, False, True): "encodings",
        }.get((model != model2, decay != decay2, encoding != encoding2))
        if what:
            key = {"experiment": experiment, "what": what, "one": _name(one, what), "other": _name(other, what)}
            same = {"model": model if what != "networks" else "", "encoding": encoding, "decay": decay}
            evidence.add("differences", difference(drawn[one], drawn[other]), key | same)


def _name(cell: tuple, what: str) -> str:
    return {"networks": cell[1], "decay": "decay" if cell[3] else "no decay", "encodings": cell[2]}[what]
