"""Maps without a network whose probabilities are rates of validation worlds: of hits kept for a time, and of tracks.

Each pixel has a kind, by what the scans show there, and a group, by where tracked movers are expected: by clouds of
particles where people walk, and by the study's tracker, which fits their shapes, in its worlds.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.linear_model import LogisticRegression

from repro.baselines.tracker import Prior, distances, track
from repro.baselines.tracker import clusters as clusters_in_time
from repro.maps.grid import Grid
from repro.maps.projection import newest_hits
from repro.maps.visibility import newest_passed
from repro.scans import Scans
from reproduce.movers.cloud import CloudSettings, cloud_map
from reproduce.movers.scenes import BINS, LATER

KINDS = 2 * len(BINS) + 1  # of pixels: hit last, passed over last, in each bin of scans since, or never seen
CLOUD = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)  # between the groups by clouds
INSIDE_M = (-4.5, -3, -2, -1.2, -0.7, -0.35, -0.1, 0.1, 0.35, 0.7, 1.2, 2)  # from the outline, between those by tracks
GROUPS = len(CLOUD) + 1
STUDY = Path(__file__).parents[1] / "results" / "workstation" / "provenance.json"


@dataclass(frozen=True)
class TrackSettings:
    """The study's tracker as it was tuned on its validation worlds."""

    near_m: float
    coast_s: float
    prior: Prior

    @classmethod
    def of_study(cls, experiment: str) -> "TrackSettings":
        """Read what was tuned in an experiment of the study."""
        steps = json.loads(STUDY.read_text(encoding="utf-8"))[f"baselines/exp{experiment}/tracker"]["steps"]
        return cls.parse(next(step for step in steps if "near_m" in step))

    @classmethod
    def parse(cls, values: dict[str, Any]) -> "TrackSettings":
        prior = Prior(**{name: values[name] for name in Prior.__dataclass_fields__})
        return cls(values["near_m"], values["coast_s"], prior)


Follower = CloudSettings | TrackSettings


def plain(follower: Follower) -> dict[str, Any]:
    """Return the settings of a follower by their names."""
    values = asdict(follower)
    prior = values.pop("prior", {})
    return values | prior


def parse(values: dict[str, Any]) -> Follower:
    """Return the follower that `plain` described."""
    return TrackSettings.parse(values) if "near_m" in values else CloudSettings(**values)


def groups(scans: Scans, grid: Grid, follower: Follower, step_s: float, range_max_m: float) -> np.ndarray:
    """Return the group of each pixel by where tracked movers are expected at the end of a window, (H, W)."""
    if isinstance(follower, CloudSettings):
        return np.digitize(cloud_map(scans, grid, follower, step_s, range_max_m), CLOUD)
    tracks = track(clusters_in_time(scans, step_s, follower.near_m), follower.prior)
    return np.digitize(-distances(tracks, grid, follower.coast_s), INSIDE_M)


def kinds(scans: Scans, grid: Grid, range_max_m: float) -> np.ndarray:
    """Return the kind of each pixel of a window, (T, N), by what its scans show there, (H, W)."""
    window = scans.batched()
    hit = newest_hits(window, grid)[0]
    passed = newest_passed(window, grid, range_max_m)[0]
    since = np.digitize(len(scans.poses) - np.maximum(hit, passed), LATER)
    kind = np.where((hit > 0) & (hit >= passed), since, since + len(BINS))
    return np.where(np.maximum(hit, passed) > 0, kind, KINDS - 1)


@dataclass(frozen=True)
class Sample:
    """Pixels of a region: group, kind, and whether a mover takes each, (P,)."""

    group: np.ndarray
    kind: np.ndarray
    taken: np.ndarray

    @property
    def untracked(self) -> "Sample":
        """The pixels as a map without tracks has them."""
        return Sample(np.zeros_like(self.group), self.kind, self.taken)


@dataclass(frozen=True)
class Rates:
    """Share of the pixels that movers take, by group and kind of the pixel, (groups, kinds)."""

    table: np.ndarray

    @classmethod
    def fit(cls, samples: Iterable[Sample]) -> "Rates":
        """Fit the log-odds as a sum of one number for the group and one for the kind to the pixels of regions."""
        counts = np.zeros((2, GROUPS, KINDS))
        for sample in samples:
            np.add.at(counts, (sample.taken.astype(int), sample.group, sample.kind), 1)
        group, kind = np.divmod(np.arange(GROUPS * KINDS), KINDS)
        design = np.concatenate([np.eye(GROUPS)[group], np.eye(KINDS)[kind]], axis=1)
        truth, weights = np.repeat([False, True], GROUPS * KINDS), counts.ravel()
        model = LogisticRegression(solver="newton-cholesky").fit(np.tile(design, (2, 1)), truth, weights)
        return cls(model.predict_proba(design)[:, 1].reshape(GROUPS, KINDS))

    def of(self, group: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """Return the probability of an obstacle at pixels."""
        return self.table[group, kind]
