"""One mapper of the comparison: tuned on validation courses, driven on test courses.

Each validation course is driven with two settings of a grid, all settings in turn, and if the grid is large, then with
one of the best quarter, as in successive halving (Jamieson and Talwalkar 2016). A Gaussian process smooths the scores
over neighbors on the grid, with an effect of each course, and the setting with the largest one is chosen. So is one in
every resample of the courses; those chosen often are driven on test courses, too, for the interval of the result.

Every episode is a row of one file, so that a run goes on where it was left.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.maps.grid import Grid
from repro.metrics.bootstrap import draw_weights
from repro.navigation.courses import Course, sample_course
from repro.navigation.episodes import Fleet
from repro.navigation.mappers import Mapper
from repro.recordings.format import spec_fingerprint
from repro.system.errors import InputError
from repro.system.files import read_mapping, write_json, write_text
from repro.system.progress import progress
from repro.worlds.spec import WorldSpec

INFLATIONS_M = (0.8, 1.6, 2.4, 3.2, 4.0, 4.8, 5.6)
WEIGHTS = (1.0, 3.0, 10.0, 30.0, 100.0)
BEYOND = {"inflation_m": (6.4,), "weight": (0.3, 300.0), "forgetting": (0.002,)}  # from the second round on, for edges
ENOUGH, KEPT = 20, 0.25  # tries of a setting after which there is no second round; share of the settings in one
SMOOTHED = ("inflation_m", "weight", "age_s", "forgetting")  # settings whose neighbors are alike
REACH, ALIKE = 2.0, 0.5  # of a neighbor, in steps of the grid; correlation of settings that differ in another axis
SPREAD = 0.05  # of the scores of settings
TRIES = 2, 1  # settings of each validation course in the two rounds
OFTEN, MOST = 0.05, 2  # share of the resamples in which a setting is chosen that is tested, and number of these
SHARED = 100  # test courses per experiment on which they are driven
BATCH = 150  # courses that are driven at the same time
FIRST = {"validation": 0, "test": 10_000}  # number of the first course of a split
EPISODES, ORIGIN = "episodes.csv", "provenance.json"  # files of a mapper
INDEX = ["split", "experiment", "seed", "settings"]  # columns that name an episode
COURSES = "courses.json"  # what the episodes of a mapper are of
SPL_SHARE = 0.1  # of the length of the path in what is tuned; the rest is the success

Settings = dict[str, Any]
Wanted = tuple[str, str, int, str]  # split, experiment, number of the course, label of the settings


@dataclass(frozen=True)
class Seeds:
    """Number of courses per experiment, for the choice of the settings and for the test."""

    validation: int
    test: int


@dataclass(frozen=True, eq=False)
class Surface:
    """The scores of S settings on C validation courses.

    Args:
        labels: of the settings, (S,).
        means: mean scores of the courses, (C,).
        deviations: scores less these, 0 where a course was not driven, (C, S).
        driven: 1 where it was, else 0, (C, S).
        kernel: correlations of the scores of settings, (S, S).
    """

    labels: Sequence[str]
    means: np.ndarray
    deviations: np.ndarray
    driven: np.ndarray
    kernel: np.ndarray

    @classmethod
    def of(cls, validation: pd.DataFrame, labels: Sequence[str] | None = None) -> "Surface":
        """Gather the episodes on validation courses, for their settings or for those of the labels."""
        score = (validation["outcome"] == "goal") + SPL_SHARE * spl(validation)
        table = validation.assign(score=score).pivot(index=["experiment", "seed"], columns="settings", values="score")
        means = table.mean(axis=1)
        own = list(map(str, table) if labels is None else labels)
        table = table.sub(means, axis=0).reindex(columns=own)
        axes = pd.DataFrame(map(settings_of, own))
        ranks = axes.rank(method="dense").fillna(0).to_numpy()
        apart = ranks[:, None] - ranks
        smooth = axes.columns.isin(SMOOTHED)
        near = np.exp(-np.square(apart[..., smooth] / REACH).sum(-1) / 2)
        kernel = near * ALIKE ** (apart[..., ~smooth] != 0).sum(-1)
        return cls(own, means.to_numpy(), table.fillna(0).to_numpy(), table.notna().to_numpy(float), kernel)

    def smoothed(self, weights: np.ndarray) -> np.ndarray:
        """Return the smoothed scores of the settings, (draws, S), given the weights of the courses, (draws, C)."""
        prior = SPREAD**2 * self.kernel
        noise = np.square(self.deviations).sum() / max(self.driven.sum() - len(self.driven), 1) + 1e-6
        share = self.driven / self.driven.sum(1, keepdims=True)
        scores = []
        for own in weights:
            counts = np.diag(own @ self.driven) - (own[:, None] * self.driven).T @ share
            gains = prior @ np.linalg.solve(counts @ prior + noise * np.eye(len(prior)), own @ self.deviations)
            scores.append(own @ (self.means - share @ gains) / own.sum() + gains)
        return np.array(scores)

    @cached_property
    def chosen(self) -> np.ndarray:
        """The labels of the settings that are chosen with all courses, then in each resample, (draws + 1,)."""
        return np.array(self.labels, dtype=object)[self.smoothed(draw_weights(len(self.driven))).argmax(1)]

    @property
    def tested(self) -> list[str]:
        """The labels of the settings that are chosen often, that of all courses first."""
        shares = pd.Series(self.chosen[1:]).value_counts(normalize=True).drop(self.chosen[0], errors="ignore")
        return [self.chosen[0], *shares.index[shares >= OFTEN][:MOST]]


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
        first = self.episodes(design(labels, self.specs, seeds.validation, TRIES[0]))
        if len(first) < ENOUGH * len(labels):
            self.episodes(design(self._best(first, len(labels)), self.specs, seeds.validation, TRIES[1]))
        tested = Surface.of(self._known().query("split == 'validation'")).tested
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
        (scores,) = surface.smoothed(np.ones((1, len(surface.driven))))
        return [labels[which] for which in np.argsort(-scores, kind="stable")[: math.ceil(KEPT * count)]]

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

    def _known(self) -> pd.DataFrame:
        """Return the episodes that were driven so far."""
        path = self.directory / EPISODES
        return pd.read_csv(path) if path.is_file() else pd.DataFrame(columns=INDEX)

    def episodes(self, wanted: Sequence[Wanted]) -> pd.DataFrame:
        """Return episodes, and drive those that are missing, in batches of similar settings."""
        rows = self._known()
        keys = [(split, experiment, FIRST[split] + number, label) for split, experiment, number, label in wanted]
        known = set(rows[INDEX].itertuples(index=False, name=None))
        missing = sorted((key for key in keys if key not in known), key=lambda key: key[3])
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


def labels_of(axes: Mapping[str, Sequence[float | None]]) -> list[str]:
    """Return the names of all settings of a grid."""
    return [label_of(dict(zip(axes, values, strict=True))) for values in product(*axes.values())]


def label_of(settings: Settings) -> str:
    """Return the name of settings; those that are None are left out."""
    return " ".join(f"{name}={value:g}" for name, value in settings.items() if value is not None)


def settings_of(label: str) -> Settings:
    """Return the settings of a name, see `label_of`."""
    return {name: float(value) for name, value in (word.split("=") for word in label.split())}


def spl(episodes: pd.DataFrame) -> pd.Series:
    """Return the success weighted by path length of every episode (Anderson et al. 2018)."""
    reached = episodes["outcome"] == "goal"
    return reached * episodes["way_m"] / np.maximum(episodes["path_m"], episodes["way_m"])
