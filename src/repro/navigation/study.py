"""One arm of the comparison: tuned on validation courses, driven on test courses, and once more for each inflation.

Every evaluation is a file of episodes, so that a run goes on where it was left.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.baselines.registry import climb
from repro.maps.grid import Grid
from repro.navigation.arms import Arm
from repro.navigation.courses import Course, sample_course
from repro.navigation.episodes import Episode, Fleet
from repro.system.files import write_text
from repro.system.progress import progress
from repro.world_config import WorldSpec

INFLATIONS_M = (0.8, 1.2, 1.6, 2.0, 2.4, 3.2, 4.0)
WEIGHTS = (5.0, 20.0, 80.0)
THRESHOLDS = (0.1, 0.2, 0.35, 0.5, 0.65)
BATCH = 100  # courses that are driven at the same time
FIRST = {"validation": 0, "test": 10_000}  # number of the first course of a split
SPL_SHARE = 0.1  # of the length of the path in what is tuned; the rest is the success

Settings = dict[str, Any]


@dataclass(frozen=True)
class Seeds:
    """Number of courses per experiment, for the choice of the settings, for the test, and for each inflation."""

    validation: int
    test: int
    curve: int


class Study:
    """The evaluations of one arm.

    Args:
        directory: where its files are.
        name: name of the arm.
        arm: the arm.
        specs: the worlds of the courses by their experiments.
        grid: grid of the maps.
    """

    def __init__(self, directory: Path, name: str, arm: Arm, specs: Mapping[str, WorldSpec], grid: Grid) -> None:
        self.directory, self.name, self.arm, self.specs, self.grid = directory / name, name, arm, specs, grid
        self.courses: dict[tuple[str, int], Course] = {}

    def run(self, seeds: Seeds) -> None:
        """Tune the arm, and drive the courses of the test with its settings and with those of every inflation."""
        self.directory.mkdir(parents=True, exist_ok=True)
        tuned = self.tuned(seeds.validation)
        test = [self.episodes("test", tuned, seeds.test)]
        curve = [
            self.episodes("test", {**tuned, "inflation_m": inflation_m}, seeds.curve) for inflation_m in INFLATIONS_M
        ]
        write_text(self.directory / "test.csv", pd.concat(test).to_csv(index=False))
        write_text(self.directory / "curve.csv", pd.concat(curve).to_csv(index=False))

    def tuned(self, count: int) -> Settings:
        """Return the settings with the best score on the validation courses of all experiments, and write all tried."""
        names = ("inflation_m", "weight", "threshold", *self.arm.candidates)

        @cache
        def score(*values: Any) -> float:
            value = score_of(self.episodes("validation", dict(zip(names, values, strict=True)), count))
            tried.append(dict(zip(names, values, strict=True)) | {"score": value})
            return value

        tried: list[dict[str, Any]] = []
        for thresholds in [(None,)] if self.arm.is_binary else [(None,), THRESHOLDS]:
            candidates: list[Any] = [INFLATIONS_M, WEIGHTS, thresholds, *self.arm.candidates.values()]
            climb(lambda values: score(*values), candidates)
        write_text(self.directory / "tried.csv", pd.DataFrame(tried).to_csv(index=False, float_format="%.4f"))
        best = max(tried, key=lambda each: each["score"])
        return {name: best[name] for name in names}

    def episodes(self, split: str, settings: Settings, count: int) -> pd.DataFrame:
        """Drive the first courses of a split in every experiment, those of earlier calls excepted."""
        label = "-".join("none" if value is None else f"{value:g}" for value in settings.values())
        path = self.directory / f"{split}-{label}.csv"
        parts = [pd.read_csv(path)] if path.is_file() else []
        known = set(zip(parts[0]["experiment"], parts[0]["seed"], strict=True)) if parts else set()
        for experiment in self.specs:
            seeds = [FIRST[split] + number for number in range(count)]
            missing = [seed for seed in seeds if (experiment, seed) not in known]
            for first in progress(range(0, len(missing), BATCH), f"{self.name} {experiment} {split} {label}"):
                found = self._drive(experiment, missing[first : first + BATCH], settings)
                rows = pd.DataFrame(map(dataclasses.asdict, found))
                parts.append(rows.assign(experiment=experiment, arm=self.name, split=split, **settings))
                write_text(path, pd.concat(parts).to_csv(index=False, float_format="%.4f"))
        rows = pd.read_csv(path)
        return rows[rows["seed"] < FIRST[split] + count]

    def _drive(self, experiment: str, seeds: list[int], settings: Settings) -> list[Episode]:
        for seed in seeds:
            if (experiment, seed) not in self.courses:
                self.courses[experiment, seed] = sample_course(self.specs[experiment], seed)[0]
        courses = [self.courses[experiment, seed] for seed in seeds]
        return Fleet(self.specs[experiment], courses, self.arm, settings, self.grid).drive()


def spl(episodes: pd.DataFrame) -> pd.Series:
    """Return the success weighted by path length of every episode (Anderson et al. 2018)."""
    reached = episodes["outcome"] == "goal"
    return reached * episodes["way_m"] / np.maximum(episodes["path_m"], episodes["way_m"])


def score_of(episodes: pd.DataFrame) -> float:
    """Return what is tuned: the share of successes, and a little of the length of the paths."""
    return float((episodes["outcome"] == "goal").mean() + SPL_SHARE * spl(episodes).mean())
