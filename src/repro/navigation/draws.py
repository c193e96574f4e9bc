"""The success of the mappers of task=navigate in resamples of the test courses, and of the choice of their settings."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from repro.metrics.bootstrap import draw_weights
from repro.navigation.surfaces import Surface


@dataclass(frozen=True, eq=False)
class MapperResult:
    """What the robots with one mapper reached.

    Args:
        surface: the scores of its settings on the validation courses.
        test: episodes on the test courses with the settings that are chosen with all validation courses.
        gains: success with each other setting less that with these, by test course; NaN where it was not driven.
    """

    surface: Surface
    test: pd.DataFrame
    gains: pd.DataFrame

    @classmethod
    def of(cls, driven: pd.DataFrame) -> "MapperResult":
        """Choose the settings, and gather the test results."""
        surface = Surface.of(driven[driven["split"] == "validation"])
        test = driven[driven["split"] == "test"].assign(success=lambda rows: (rows["outcome"] == "goal").astype(float))
        by_course = test.pivot(index=["experiment", "seed"], columns="settings", values="success")
        chosen = surface.chosen[0]
        gains = by_course.drop(columns=chosen).sub(by_course[chosen], axis=0)
        return cls(surface, test[test["settings"] == chosen], gains)

    @property
    def settings(self) -> str:
        """The settings of the planner and the mapper that are chosen with all validation courses."""
        return self.surface.chosen[0]

    @property
    def covered(self) -> float:
        """Share of the resamples of the validation courses whose settings were driven on test courses."""
        return float(np.isin(self.surface.chosen[1:], [self.settings, *self.gains]).mean())

    def shifts(self, courses: pd.Index, weights: np.ndarray) -> np.ndarray:
        """Return the success with the settings of each resample less that with the chosen ones, (draws + 1,).

        Settings that were not driven on test courses have no shift.
        """
        is_chosen = self.surface.chosen[:, None] == self.gains.columns.to_numpy()
        return (is_chosen * _means(self.gains.reindex(courses), weights)).sum(1)


@dataclass(frozen=True, eq=False)
class Draws:
    """The success of mappers in resamples of the test courses of an experiment, and of the choice of the settings.

    Args:
        success: by course and mapper; NaN where a course was not driven.
        time_s: to the second goal, NaN where it was not reached.
        weights: of the courses with all of them, then in each resample, (draws + 1, C).
        shifts: see `MapperResult.shifts`, by mapper.
    """

    success: pd.DataFrame
    time_s: pd.DataFrame
    weights: np.ndarray
    shifts: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, test: pd.DataFrame, found: Mapping[str, MapperResult]) -> "Draws":
        """Gather the episodes of an experiment with the chosen settings."""
        success, time_s = (
            test.pivot(index=["experiment", "seed"], columns="mapper", values=value) for value in ("success", "time_s")
        )
        weights = draw_weights(len(success))
        shifts = {mapper: found[mapper].shifts(success.index, weights) for mapper in map(str, success)}
        return cls(success, time_s.where(success == 1), weights, shifts)

    def level(self, mapper: str) -> np.ndarray:
        """Return the success of a mapper, (draws + 1,)."""
        return _means(self.success[mapper], self.weights) + self.shifts[mapper]

    def gain(self, mapper: str, other: str, fixed: bool = False) -> np.ndarray:
        """Return how much more often a mapper succeeds than another one on shared courses, (draws + 1,)."""
        gain = _means(self.success[mapper] - self.success[other], self.weights)
        return gain if fixed else gain + self.shifts[mapper] - self.shifts[other]

    def later(self, mapper: str, other: str) -> float:
        """Return how much longer a mapper takes than another one where both succeed [s]."""
        return float((self.time_s[mapper] - self.time_s[other]).mean())


def _means(values: pd.Series | pd.DataFrame, weights: np.ndarray) -> np.ndarray:
    """Return the means over the courses that have a value, (draws + 1,) or (draws + 1, columns); 0 if none has one."""
    known = values.notna().to_numpy(float)
    return weights @ values.fillna(0).to_numpy() / np.maximum(weights @ known, 1)
