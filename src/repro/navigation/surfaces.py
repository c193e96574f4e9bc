"""The scores of the settings of a mapper on validation courses, smoothed over neighbors, and the names of settings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from repro.metrics.bootstrap import draw_weights

SMOOTHED = ("inflation_m", "weight", "age_s", "forgetting")  # settings whose neighbors are alike
REACH, ALIKE = 2.0, 0.5  # of a neighbor, in steps of the grid; correlation of settings that differ in another axis
SPREAD = 0.05  # of the scores of settings
OFTEN = 0.03  # share of the resamples in which a setting is chosen that may be the best one
SPL_SHARE = 0.1  # of the success weighted by path length in what is tuned, added to the success

Settings = dict[str, Any]


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
    def scores(self) -> np.ndarray:
        """The smoothed scores of the settings with all courses, then in each resample, (draws + 1, S)."""
        return self.smoothed(draw_weights(len(self.driven)))

    @property
    def chosen(self) -> np.ndarray:
        """The labels of the settings that are chosen with all courses, then in each resample, (draws + 1,)."""
        return np.array(self.labels, dtype=object)[self.scores.argmax(1)]

    def often(self, most: int) -> list[str]:
        """Return the labels of the settings that are chosen often, at most a number, that of all courses first."""
        shares = pd.Series(self.chosen[1:]).value_counts(normalize=True).drop(self.chosen[0], errors="ignore")
        return [self.chosen[0], *shares.index[shares >= OFTEN]][:most]


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
