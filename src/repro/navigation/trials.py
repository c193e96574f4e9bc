"""One mapper of the comparison: tuned on validation courses, driven on test courses, and once more for each inflation.

Every evaluation is a file of episodes, so that a run goes on where it was left.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.baselines.registry import climb
from repro.maps.grid import Grid
from repro.navigation.courses import Course, sample_course
from repro.navigation.episodes import Fleet
from repro.navigation.mappers import Mapper
from repro.recordings.format import spec_fingerprint
from repro.system.errors import InputError
from repro.system.files import read_mapping, write_json, write_text
from repro.system.progress import progress
from repro.worlds.spec import WorldSpec

WEIGHTS = (5.0, 20.0, 80.0)
THRESHOLDS = (0.1, 0.2, 0.35, 0.5, 0.65)
BATCH = 150  # courses that are driven at the same time
FIRST = {"validation": 0, "test": 10_000}  # number of the first course of a split
TEST, CURVE, TRIED, ORIGIN = "test.csv", "curve.csv", "tried.csv", "provenance.json"  # files of a mapper
COURSES = "courses.json"  # what the episodes of a mapper are of
SPL_SHARE = 0.1  # of the length of the path in what is tuned; the rest is the success

Settings = dict[str, Any]


@dataclass(frozen=True)
class Seeds:
    """Number of courses per experiment, for the choice of the settings, for the test, and for each inflation."""

    validation: int
    test: int
    curve: int


class Trials:
    """The trials of one mapper.

    Args:
        directory: where its files are.
        name: name of the mapper.
        mapper: the mapper.
        specs: the worlds of the courses by their experiments.
        grid: grid of the maps.
        inflations_m: candidates of the inflation [m].
    """

    def __init__(
        self,
        directory: Path,
        name: str,
        mapper: Mapper,
        specs: Mapping[str, WorldSpec],
        grid: Grid,
        *,
        inflations_m: Sequence[float],
    ) -> None:
        self.directory, self.name, self.mapper, self.specs, self.grid = directory / name, name, mapper, specs, grid
        self.inflations_m = tuple(inflations_m)
        self.courses: dict[tuple[str, int], Course] = {}
        self.driven = 0  # episodes of the present run

    def run(self, seeds: Seeds, origin: Mapping[str, Any]) -> None:
        """Tune the mapper, and drive the courses of the test with its settings and with those of every inflation.

        Args:
            seeds: numbers of courses.
            origin: the provenance of the episodes that are driven now, which is added to that of earlier ones.

        Raises:
            InputError: the directory has episodes of other worlds, maps or weights.
        """
        self.directory.mkdir(parents=True, exist_ok=True)
        self._check_courses()
        self.driven = 0
        tuned = self.tuned(seeds.validation)
        test = self.episodes("test", tuned, seeds.test)
        curve = [
            self.episodes("test", {**tuned, "inflation_m": inflation_m}, seeds.curve)
            for inflation_m in self.inflations_m
        ]
        write_text(self.directory / TEST, test.to_csv(index=False))
        write_text(self.directory / CURVE, pd.concat(curve).to_csv(index=False))
        path = self.directory / ORIGIN
        steps = read_mapping(path, "the provenance of a mapper")["steps"] if path.is_file() else []
        if self.driven or not steps:
            steps.append({"seeds": dataclasses.asdict(seeds), "episodes": self.driven, **origin})
        write_json(path, {"steps": steps})

    def _check_courses(self) -> None:
        """Refuse to mix episodes, and write of what they are."""
        present: dict[str, Any] = {name: spec_fingerprint(spec) for name, spec in self.specs.items()}
        present |= {"grid": dataclasses.asdict(self.grid), "weights": self.mapper.weights}
        path = self.directory / COURSES
        known = read_mapping(path, "the courses of a mapper") if path.is_file() else {}
        if other := [name for name in present if name in known and known[name] != present[name]]:
            raise InputError(
                f"{self.directory} has episodes with another value of {', '.join(other)}: expected those of this call; "
                "choose other outputs, or delete it"
            )
        write_json(path, known | present)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the settings."""
        return ("inflation_m", "weight", "threshold", *self.mapper.candidates)

    def tuned(self, count: int) -> Settings:
        """Return the settings with the best score on the validation courses of all experiments, and write all tried."""

        @cache
        def score(*values: Any) -> float:
            settings = dict(zip(self.names, values, strict=True))
            tried.append({**settings, "score": score_of(self.episodes("validation", settings, count))})
            return tried[-1]["score"]

        tried: list[dict[str, Any]] = []
        candidates: list[Any] = [self.inflations_m, WEIGHTS, (None,), *self.mapper.candidates.values()]
        found = climb(lambda values: score(*values), candidates)
        score(*found)  # where there is no choice
        if not self.mapper.is_binary:
            candidates[2] = THRESHOLDS
            start = (*found[:2], THRESHOLDS[len(THRESHOLDS) // 2], *found[3:])
            climb(lambda values: score(*values), candidates, start)
        write_text(self.directory / TRIED, pd.DataFrame(tried).to_csv(index=False, float_format="%.4f"))
        best = max(tried, key=lambda settings: settings["score"])
        return {name: best[name] for name in self.names}

    def episodes(self, split: str, settings: Settings, count: int) -> pd.DataFrame:
        """Drive the first courses of a split in every experiment, those of earlier calls excepted."""
        label = "-".join("none" if value is None else f"{value:g}" for value in settings.values())
        path = self.directory / f"{split}-{label}.csv"
        parts = [pd.read_csv(path)] if path.is_file() else []
        known = set(zip(parts[0]["experiment"], parts[0]["seed"], strict=True)) if parts else set()
        wanted = [(experiment, FIRST[split] + number) for experiment in self.specs for number in range(count)]
        missing = [course for course in wanted if course not in known]
        for first in progress(range(0, len(missing), BATCH), f"{self.name}, {split} {label}"):
            parts.append(self._drive(missing[first : first + BATCH], settings).assign(split=split))
            write_text(path, pd.concat(parts).to_csv(index=False, float_format="%.4f"))
        rows = pd.read_csv(path)
        return rows[(rows["seed"] < FIRST[split] + count) & rows["experiment"].isin(self.specs)]

    def _drive(self, names: list[tuple[str, int]], settings: Settings) -> pd.DataFrame:
        """Drive courses of several experiments, which have the same robot."""
        for experiment, seed in names:
            if (experiment, seed) not in self.courses:
                self.courses[experiment, seed] = sample_course(self.specs[experiment], seed)[0]
        spec, courses = next(iter(self.specs.values())), [self.courses[name] for name in names]
        episodes = Fleet(spec, courses, self.mapper, settings, self.grid).drive()
        self.driven += len(episodes)
        rows = pd.DataFrame(map(dataclasses.asdict, episodes))
        return rows.assign(experiment=[experiment for experiment, _ in names], mapper=self.name, **settings)


def spl(episodes: pd.DataFrame) -> pd.Series:
    """Return the success weighted by path length of every episode (Anderson et al. 2018)."""
    reached = episodes["outcome"] == "goal"
    return reached * episodes["way_m"] / np.maximum(episodes["path_m"], episodes["way_m"])


def score_of(episodes: pd.DataFrame) -> float:
    """Return what is tuned: the share of successes, and a little of the length of the paths."""
    return float((episodes["outcome"] == "goal").mean() + SPL_SHARE * spl(episodes).mean())
