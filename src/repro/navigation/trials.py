"""One mapper of the comparison: tuned on validation courses, driven on test courses.

Each validation course is driven with two settings of a grid, all settings in turn, and if the grid is large, then with
one of the best quarter, as in successive halving (Jamieson and Talwalkar 2016). A Gaussian process smooths the scores
over neighbors on the grid, with an effect of each course, and the setting with the largest one is chosen. So is one in
every resample of the courses. Those chosen often are driven on more courses, the best three of them on all. The setting
chosen last is driven on test courses, and so are those that are still chosen often, for the interval of the result.

Every episode is a row of one file, so that a run goes on where it was left.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.maps.grid import Grid
from repro.navigation.courses import Course, sample_course
from repro.navigation.episodes import Fleet
from repro.navigation.mappers import Mapper
from repro.navigation.surfaces import Settings, Surface, labels_of, settings_of
from repro.recordings.format import spec_fingerprint
from repro.system.errors import InputError
from repro.system.files import first_line, read_mapping, write_json, write_text
from repro.system.progress import progress, say
from repro.worlds.spec import WorldSpec

INFLATIONS_M = (0.8, 1.6, 2.4, 3.2, 4.0, 4.8, 5.6)
WEIGHTS = (1.0, 3.0, 10.0, 30.0, 100.0)
BEYOND = {"inflation_m": (6.4,), "weight": (0.3, 300.0), "forgetting": (0.002, 0.4)}  # in the second round, for edges
ENOUGH, KEPT = 20, 0.25  # tries of a setting after which there is no second round; share of the settings in one
TRIES = 2, 1  # settings of each validation course in the two rounds
FINALS = (8, 2), (3, 3)  # most settings of a later round, and how many of them each validation course has
TESTED, SHARED = 7, 100  # most settings on test courses; courses per experiment of those that are not the chosen one
BATCH = 150  # courses that are driven at the same time
FIRST = {"validation": 0, "test": 10_000}  # number of the first course of a split
EPISODES, ORIGIN = "episodes.csv", "provenance.json"  # files of a mapper
INDEX = ["split", "experiment", "seed", "settings"]  # columns that name an episode
COURSES = "courses.json"  # what the episodes of a mapper are of

Wanted = tuple[str, str, int, str]  # split, experiment, number of the course, label of the settings


@dataclass(frozen=True)
class Seeds:
    """Number of courses per experiment, for the choice of the settings and for the test."""

    validation: int
    test: int


class Trials:
    """The trials of one mapper.

    Args:
        directory: where its files are.
        name: name of the mapper.
        mapper: the mapper.
        specs: the worlds of the courses by their experiments.
        grid: grid of the maps.
    """

    def __init__(self, directory: Path, name: str, mapper: Mapper, specs: Mapping[str, WorldSpec], grid: Grid) -> None:
        self.directory, self.name, self.mapper, self.specs, self.grid = directory / name, name, mapper, specs, grid
        self.axes: dict[str, Sequence[float | None]] = {"inflation_m": INFLATIONS_M, "weight": WEIGHTS}
        self.axes |= mapper.candidates
        self.courses: dict[tuple[str, int], Course] = {}

    def run(self, seeds: Seeds, origin: Mapping[str, Any]) -> Settings:
        """Tune the mapper, and drive the courses of the test with the settings that are chosen; return these.

        Args:
            seeds: numbers of courses.
            origin: the provenance of the episodes that are driven now, which is added to that of earlier ones.

        Raises:
            InputError: the directory has episodes of other worlds, maps or weights.
        """
        self.directory.mkdir(parents=True, exist_ok=True)
        self._check_courses()
        labels = labels_of(self.axes)
        wanted = design(labels, self.specs, seeds.validation, TRIES[0])
        rows = self.episodes(wanted)
        if len(rows) < ENOUGH * len(labels):
            wanted += design(self._best(rows, len(labels)), self.specs, seeds.validation, TRIES[1])
            rows = self.episodes(wanted)
        for most, tries in FINALS:
            wanted += design(Surface.of(rows).often(most), self.specs, seeds.validation, tries)
            rows = self.episodes(wanted)
        tested = Surface.of(rows).often(TESTED)
        for label, count in zip(tested, [seeds.test] + [min(SHARED, seeds.test)] * (len(tested) - 1), strict=True):
            self.episodes([("test", name, number, label) for name in self.specs for number in range(count)])
        path = self.directory / ORIGIN
        steps = read_mapping(path, "the provenance of a mapper")["steps"] if path.is_file() else []
        if driven := len(self._known()) - sum(step["episodes"] for step in steps):
            steps.append({"seeds": dataclasses.asdict(seeds), "episodes": driven, **origin})
        write_json(path, {"steps": steps})
        return settings_of(tested[0])

    def _best(self, first: pd.DataFrame, count: int) -> list[str]:
        """Return the best of a number of settings after the first round, also beyond the edges of the grid."""
        labels = labels_of({name: (*values, *BEYOND.get(name, ())) for name, values in self.axes.items()})
        surface = Surface.of(first, labels)
        order = np.argsort(-surface.smoothed(np.ones((1, len(surface.driven))))[0], kind="stable")
        return [labels[which] for which in order[: math.ceil(KEPT * count)]]

    def _check_courses(self) -> None:
        """Refuse to mix episodes, and write of what they are."""
        present: dict[str, Any] = {name: spec_fingerprint(spec) for name, spec in self.specs.items()}
        present |= {"grid": dataclasses.asdict(self.grid), "weights": self.mapper.weights}
        path = self.directory / COURSES
        known = read_mapping(path, "the courses of a mapper") if path.is_file() else {}
        if other := [name for name in present if name in known and known[name] != present[name]]:
            values = f" ({known['grid']}, this call has {present['grid']})" if "grid" in other else ""
            raise InputError(
                f"{self.directory} has episodes with another value of {', '.join(other)}{values}: "
                "choose other outputs, or delete it"
            )
        write_json(path, known | present)

    def _known(self) -> pd.DataFrame:
        """Return the episodes that were driven so far."""
        path = self.directory / EPISODES
        return read_episodes(path) if path.is_file() else pd.DataFrame(columns=INDEX)

    def episodes(self, wanted: Sequence[Wanted]) -> pd.DataFrame:
        """Return episodes, each once, and drive those that are missing, in batches of similar settings."""
        rows = self._known()
        named = ((split, name, FIRST[split] + number, label) for split, name, number, label in wanted)
        keys = list(dict.fromkeys(named))
        known = set(rows[INDEX].itertuples(index=False, name=None))
        missing = sorted((key for key in keys if key not in known), key=lambda key: key[3])
        if missing:
            say(f"{self.name}, {keys[0][0]}: {len(missing)} episodes to drive, {min(BATCH, len(missing))} at a time")
        for first in progress(range(0, len(missing), BATCH), f"{self.name}, {keys[0][0]}"):
            driven = self._drive(missing[first : first + BATCH])
            rows = pd.concat([rows, driven], ignore_index=True) if len(rows) else driven
            write_text(self.directory / EPISODES, rows.to_csv(index=False, float_format="%.4f"))
        return rows.set_index(INDEX).loc[keys].reset_index()

    def _drive(self, keys: Sequence[Wanted]) -> pd.DataFrame:
        """Drive courses of several experiments, which have the same robot."""
        for _, experiment, seed, _ in keys:
            if (experiment, seed) not in self.courses:
                self.courses[experiment, seed] = sample_course(self.specs[experiment], seed)[0]
        spec, courses = next(iter(self.specs.values())), [self.courses[key[1:3]] for key in keys]
        settings = [settings_of(label) for *_, label in keys]
        rows = pd.DataFrame(map(dataclasses.asdict, Fleet(spec, courses, self.mapper, settings, self.grid).drive()))
        splits, experiments, _, labels = zip(*keys, strict=True)
        return rows.assign(split=splits, experiment=experiments, settings=labels, mapper=self.name)


def read_episodes(path: Path) -> pd.DataFrame:
    """Read the episodes of a mapper.

    Raises:
        InputError: the file is no table of episodes, or was cut.
    """
    try:
        rows = pd.read_csv(path)
        is_whole = bool(rows[[*INDEX, "outcome"]].notna().to_numpy().all())
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path} is no table of episodes ({first_line(error)}): delete it") from error
    if not is_whole:
        raise InputError(f"{path} has rows that were cut: delete these, or the file")
    return rows


def design(labels: Sequence[str], experiments: Iterable[str], count: int, tries: int) -> list[Wanted]:
    """Return which settings each validation course is driven with.

    All settings of an experiment have their turn before one comes again; more courses change nothing for the others.
    """
    found: list[Wanted] = []
    for place, experiment in enumerate(experiments):
        rng = np.random.default_rng(place)
        turns: list[int] = []
        for number in range(count):
            own: list[int] = []
            while len(own) < min(tries, len(labels)):
                turns += [] if set(turns) - set(own) else rng.permutation(len(labels)).tolist()
                own.append(next(which for which in turns if which not in own))
                turns.remove(own[-1])
            found += [("validation", experiment, number, labels[which]) for which in own]
    return found
