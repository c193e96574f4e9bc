"""The mappers of the comparison: from what robots have seen so far to the maps that they plan on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np

from repro.baselines.occupancy_grids import HIT_GAIN, PASSED_GAIN, PRIOR_LOGIT, observation
from repro.baselines.tracker import Prior, clusters, distances, track
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.maps.outlines import padded
from repro.navigation.courses import TURN_STEPS, Course
from repro.navigation.planner import HORIZON_S, LAYER_S
from repro.networks.predictor import Predictor
from repro.scans import Scans
from repro.system.compiled import compiled

AHEAD_S = np.arange(0, HORIZON_S, LAYER_S)  # times of the maps of a mapper that knows velocities, from now on
AT_ONCE = 2  # windows of a call of the network, which is slower with more
NEVER = -(10**6)  # step of what has not been seen


@dataclass(eq=False)
class Seen:
    """What E robots have seen: the last scans, and when each pixel was last hit and passed over.

    Args:
        courses: the courses of the robots.
        states: of their obstacles before the first step and after each one so far, (O, E, S, 3).
        grid: grid of the maps.
        angles: beam angles [rad], (N,).
        range_max_m: maximum range [m].
        step_s: duration of a step [s].
        forgetting: share of the log-odds that is forgotten in every step by each robot, (E,); NaN where no map needs
            them.
    """

    courses: Sequence[Course]
    states: np.ndarray
    grid: Grid
    angles: np.ndarray
    range_max_m: float
    step_s: float
    forgetting: np.ndarray
    step: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        robots, size = len(self.courses), self.grid.size_px
        self.ranges = np.full((robots, TURN_STEPS, len(self.angles)), np.nan, dtype=np.float32)
        self.poses = np.zeros((robots, TURN_STEPS, 3))
        self.hit, self.passed = (np.full((robots, size, size), NEVER, dtype=np.int32) for _ in range(2))
        self.log_odds = np.zeros((robots, size, size), dtype=np.float32)

    def add(self, who: np.ndarray, ranges: np.ndarray, poses: np.ndarray) -> None:
        """Add the scans of the next step, (K, N), at poses (K, 3), of K robots that still drive."""
        self.ranges[who, self.step % TURN_STEPS], self.poses[who, self.step % TURN_STEPS] = ranges, poses
        self.step += 1
        scans = Scans(ranges[:, None], self.angles, poses[:, None]).batched()
        hit, passed = observation(scans, self.grid, self.range_max_m)
        _note(self.hit, who, hit, self.step)
        _note(self.passed, who, passed, self.step)
        if not np.isnan(self.forgetting).any():
            kept = 1 - self.forgetting[who, None, None]
            log_odds = kept * self.log_odds[who] + HIT_GAIN * hit + PASSED_GAIN * passed
            self.log_odds[who] = np.clip(log_odds, -8, 8)

    def hits(self, who: np.ndarray, age_s: float) -> np.ndarray:
        """Return the pixels whose last hit is at most this old [s] and later than the last passing beam, (K, H, W)."""
        hit = self.hit[who]
        return (hit > self.passed[who]) & ((self.step - hit) * self.step_s <= age_s + 1e-9)

    def window(self, who: np.ndarray) -> Scans:
        """Return the last scans of K robots as a batch of windows."""
        order = (np.arange(TURN_STEPS) + self.step) % TURN_STEPS
        return Scans(self.ranges[who][:, order], self.angles, self.poses[who][:, order].astype(np.float32))


@compiled
def _note(newest: np.ndarray, who: np.ndarray, observed: np.ndarray, step: int) -> None:
    """Write the step to the pixels (E, H, W) that K robots observed, (K, H, W)."""
    for number, row, column in np.ndindex(observed.shape):
        if observed[number, row, column]:
            newest[who[number], row, column] = step


Maps = Callable[[Seen, np.ndarray], np.ndarray]  # probabilities of an obstacle now, or also later, (K, 1 or L, H, W)


@dataclass(frozen=True)
class Mapper:
    """One way to make maps.

    Args:
        maps: the function, with those settings of `candidates` as keywords that are not the planner's.
        candidates: the values of further settings that are tuned, of the function or of the planner.
        lidar: its field of view: `robot`, that of the world; `circle`, 360 degrees; `none`, which needs no scans.
        weights: checksum of the weights of its network; empty without one.
    """

    maps: Callable[..., np.ndarray]
    candidates: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    lidar: Literal["robot", "circle", "none"] = "robot"
    weights: str = ""


def _hits(seen: Seen, who: np.ndarray, *, age_s: float) -> np.ndarray:
    return seen.hits(who, age_s)[:, None].astype(np.float32)


def _log_odds(seen: Seen, who: np.ndarray, *, forgetting: float) -> np.ndarray:
    assert np.allclose(seen.forgetting[who], forgetting), "the grid is filtered scan by scan"
    return 1 / (1 + np.exp(-(seen.log_odds[who, None] + PRIOR_LOGIT)))


def _network(predictor: Predictor, seen: Seen, who: np.ndarray) -> np.ndarray:
    return 1 - predictor.predict(seen.window(who), AT_ONCE, allow_empty=True)[:, None]


def _tracked(settings: Mapping[str, float], seen: Seen, who: np.ndarray) -> np.ndarray:
    """Return the tracked shapes now and ahead, with the settings that `baselines.registry.tracker` tunes."""
    chosen = dict(settings)
    near_m, coast_s, margin_m = (chosen.pop(key) for key in ("near_m", "coast_s", "margin_m"))
    free_steps, prior = chosen.pop("free_steps"), Prior(**chosen)
    window = seen.window(who)
    maps = []
    for index in range(len(who)):
        tracks = track(clusters(window[index], seen.step_s, near_m), prior)
        maps.append([distances(tracks, seen.grid, coast_s, ahead_s) <= margin_m for ahead_s in AHEAD_S])
    passed = seen.passed[who]
    occupied = np.array(maps)
    occupied[:, 0] &= ~((passed > seen.hit[who]) & (seen.step - passed < free_steps))
    return occupied.astype(np.float32)


def _truth(seen: Seen, who: np.ndarray, *, ahead_s: np.ndarray) -> np.ndarray:
    """Return the true maps, of obstacles that keep their present velocity."""
    courses = [seen.courses[index] for index in who]
    before, now = (
        [seen.states[: len(course.outlines), index, step] for course, index in zip(courses, who, strict=True)]
        for step in (seen.step - 1, seen.step)
    )
    velocity = [(new - old) / seen.step_s for old, new in zip(before, now, strict=True)]
    states = [place + later * speed for place, speed in zip(now, velocity, strict=True) for later in ahead_s]
    outlines = [course.outlines for course in courses for _ in ahead_s]
    owner = np.repeat(np.arange(len(states)), [len(own) for own in states])
    longest = max(own.shape[1] for own in outlines)
    free = rasterize(
        np.concatenate([padded(own, longest) for own in outlines]),
        np.concatenate(states),
        owner,
        len(states),
        seen.grid,
    )
    return 1 - free.reshape(len(who), len(ahead_s), *free.shape[1:]).astype(np.float32)


AGES_S = (1.0, 3.0, 10.0, 30.0)
THRESHOLDS = (None, 0.1, 0.2, 0.35)
CLASSICAL = {
    "scan": Mapper(partial(_hits, age_s=0.0)),
    "keep": Mapper(partial(_hits, age_s=1000.0)),
    "decay": Mapper(_hits, {"age_s": AGES_S}),
    "log_odds": Mapper(_log_odds, {"forgetting": (0.005, 0.02, 0.05, 0.15), "threshold": THRESHOLDS}),
    "full_circle": Mapper(_hits, {"age_s": (3.0, 10.0, 1000.0)}, lidar="circle"),
    "truth": Mapper(partial(_truth, ahead_s=AHEAD_S[:1]), lidar="none"),
    "true_velocities": Mapper(partial(_truth, ahead_s=AHEAD_S), lidar="none"),
}


def network_mapper(predictor: Predictor, *, weights: str = "") -> Mapper:
    """Return the mapper of a trained network."""
    return Mapper(partial(_network, predictor), {"threshold": THRESHOLDS}, weights=weights)


def tracker_mapper(settings: Mapping[str, float]) -> Mapper:
    """Return the mapper of the tracker with settings that `baselines.registry` has tuned."""
    return Mapper(partial(_tracked, settings))
