"""Data association: which hits of a recording belong to one obstacle, and what that obstacle is.

Hits are clustered over space and time. One obstacle explains each cluster: its shape and path are sampled given some of
its hits and of the beams that pass (`particles`). Hits of other clusters that it explains become its own, and two
obstacles are joined if one explains the hits of both as well.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from sklearn.cluster import DBSCAN

from repro.baselines import particles as model
from repro.baselines.laws import Scanned, check_laws
from repro.baselines.tempering import temper
from repro.scans import Scans
from repro.world_config import WorldSpec

PARTICLES = 384  # of each obstacle
MOST_HITS = 120  # of an obstacle that are used, spread over all
NEAR_M, NEAR_STEPS = 1.2, 4  # hits closer than this belong to one cluster
FEWEST = 3  # hits of an obstacle
EXPLAINED_M = 0.25  # a hit this close to the outlines of most particles is explained
GOOD, ATTEMPTS = 8.0, 2  # mean energy of a fit that is not tried again, number of trials
PRIOR_ROUNDS = 40  # of draws for starts on the map
ROUNDS = 3  # fits of one obstacle while the hits that it explains change
SAME_M = 3.0  # between the inferred centers of one obstacle, besides its motion
JOINED_SHARE, JOINED_ENERGY = 0.95, 50.0  # of the hits of both, at least; more than of two, at most


@dataclass(frozen=True)
class Seen:
    """What a recording tells.

    Args:
        scans: see `particles.energies`.
        steps: step of every hit, (H,).
        points: place of every hit [m], (H, 2).
        spec: the laws of the worlds.
        rng: random generator.
    """

    scans: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    steps: np.ndarray
    points: np.ndarray
    spec: WorldSpec
    rng: np.random.Generator

    def motion(self, reference: int) -> model.Motion:
        """Return the parameters of the motion for particles that are at their x and y at a step."""
        middle_m = self.spec.world.width / 2
        return self.spec.world.step_time, middle_m, middle_m, self.spec.clear_radius_m, reference


@dataclass(frozen=True, eq=False)
class Inferred:
    """An obstacle: particles (K, PARAMETERS), the step of their x and y, its hits' indices, the mean energy."""

    particles: np.ndarray
    reference: int
    hits: np.ndarray
    energy: float

    def center(self) -> np.ndarray:
        """Return the mean of x and y of the particles [m], (2,)."""
        return self.particles[:, model.X : model.Y + 1].mean(0)


def observe(scanned: Scanned, range_max_m: float, spec: WorldSpec, rng: np.random.Generator) -> Seen:
    """Return what ranges (T, N), inf for a miss, angles (N,) and poses (T, 3) tell."""
    ranges, angles, poses = scanned
    headings = poses[:, 2:] + angles
    directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    points, hit = Scans(ranges, angles, poses).points()
    robot = np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    reached = np.where(hit, ranges, range_max_m)
    return Seen((reached, angles, robot, directions), np.nonzero(hit)[0], points[hit], spec, rng)


def explain(seen: Seen) -> list[Inferred]:
    """Explain the hits of a recording by obstacles, those of large clusters first."""
    if not len(seen.steps):
        return []
    places = np.column_stack([seen.points, seen.steps * NEAR_M / NEAR_STEPS])
    label = DBSCAN(eps=NEAR_M, min_samples=1).fit_predict(places)  # -1 afterwards: explained, or too few
    found: list[Inferred] = []
    while (counts := np.bincount(label[label >= 0], minlength=1)).max() >= FEWEST:
        cluster = np.flatnonzero(label == counts.argmax())
        each = _explain_cluster(seen, cluster, np.flatnonzero(label >= 0))
        label[each.hits] = -1
        rest = cluster[label[cluster] >= 0]
        label[rest] = label.max() + 1 if len(rest) < len(cluster) else -1
        if len(each.hits) >= FEWEST:
            found.append(each)
    return _join(seen, found)


def _explain_cluster(seen: Seen, cluster: np.ndarray, left: np.ndarray) -> Inferred:
    """Fit an obstacle to a cluster, then to those of the hits that are left which it explains; keep these hits."""
    each = fit(seen, cluster)
    for _ in range(ROUNDS - 1):
        hits = left[_explains(seen, each, left)]
        if len(hits) < FEWEST or np.array_equal(hits, each.hits):
            break
        each = fit(seen, hits)
    return replace(each, hits=each.hits[_explains(seen, each, each.hits)])


def _join(seen: Seen, found: list[Inferred]) -> list[Inferred]:
    """Join obstacles that one explains as well as two: one that is seen again later, or around another one."""
    apart: set[tuple[Inferred, Inferred]] = set()
    while pairs := [pair for pair in combinations(found, 2) if pair not in apart and _may_be_one(seen, *pair)]:
        first, second = pairs[0]
        both = fit(seen, np.union1d(first.hits, second.hits))
        is_one = _explains(seen, both, both.hits).mean() >= JOINED_SHARE
        alone = sum(_energy(seen, each, each.hits) for each in (first, second))
        if is_one and sum(_energy(seen, both, each.hits) for each in (first, second)) <= alone + JOINED_ENERGY:
            found = [each for each in found if each not in (first, second)] + [both]
        else:
            apart.add((first, second))
    return found


def _energy(seen: Seen, each: Inferred, hits: np.ndarray) -> float:
    """Return the mean energy of the particles of an obstacle, given hits."""
    used = _spread(hits)
    known = (seen.motion(each.reference), (seen.steps[used], seen.points[used]), seen.scans)
    return float(model.energies(each.particles, *known).mean())


def _may_be_one(seen: Seen, first: Inferred, second: Inferred) -> bool:
    """Return whether an obstacle is fast enough to be both."""
    fastest = parameter_bounds(seen.spec)[1, model.SPEED]
    way_m = fastest * seen.spec.world.step_time * abs(first.reference - second.reference)
    return bool(np.linalg.norm(first.center() - second.center()) < way_m + SAME_M)


def fit(seen: Seen, hits: np.ndarray) -> Inferred:
    """Sample the obstacle of hits, given by their indices; a poor fit is tried again with twice the particles."""
    fits = []
    for attempt in range(ATTEMPTS):
        fits.append(_sample(seen, hits, PARTICLES * 2**attempt))
        if fits[-1].energy < GOOD:
            break
    return min(fits, key=lambda each: each.energy)


def _sample(seen: Seen, hits: np.ndarray, count: int) -> Inferred:
    """Sample particles from the posterior of the obstacle of hits."""
    reference = int(seen.steps[hits[len(hits) // 2]])
    motion, bounds = seen.motion(reference), parameter_bounds(seen.spec)
    center_m = seen.points[hits][seen.steps[hits] == reference].mean(0)
    farthest = np.array(bounds[1])
    farthest[model.IS_DISC] = 0
    reach_m = model.shape(farthest)[5]
    bounds[:, model.X : model.Y + 1] = center_m - reach_m, center_m + reach_m
    particles = _prior(bounds, motion, seen, count)
    used = seen.rng.permutation(_spread(hits))  # a poor proposal is seen after few hits
    known = (motion, (seen.steps[used], seen.points[used]), seen.scans)
    energy = model.energies(particles, *known)

    def move(particles: np.ndarray, energy: np.ndarray, weight: float) -> None:
        model.move(particles, energy, weight, bounds, *known, seen.rng)

    temper(particles, energy, move, seen.rng)
    return Inferred(particles, reference, hits, float(energy.mean()))


def _prior(bounds: np.ndarray, motion: model.Motion, seen: Seen, count: int) -> np.ndarray:
    """Draw particles from the prior; if few start on the map, each is drawn several times.

    If none does, as with hits of several obstacles, the last ones drawn are used; their high energy makes `fit` and the
    caller try other clusters.
    """
    starting: list[np.ndarray] = []
    for _ in range(PRIOR_ROUNDS):
        drawn = seen.rng.uniform(bounds[0], bounds[1], (count, model.PARAMETERS))
        drawn[:, model.IS_DISC] = seen.rng.random(count) < check_laws(seen.spec).disc_share
        starting += [particle for particle in drawn if model.starts_on_map(particle, motion)]
        if len(starting) >= count:
            break
    return np.resize(starting or drawn, (count, model.PARAMETERS))


def _spread(hits: np.ndarray) -> np.ndarray:
    """Return at most `MOST_HITS` of hits, spread over all."""
    return hits[np.unique(np.linspace(0, len(hits) - 1, MOST_HITS).round().astype(int))]


def parameter_bounds(spec: WorldSpec) -> np.ndarray:
    """Return the least and the largest value of each parameter by the laws, (2, PARAMETERS); x and y are left at 0."""
    population = check_laws(spec)
    behavior = population.behavior
    speed, turn = (behavior.speed_m_s, behavior.turn_steps) if behavior else ((0.0, 0.0), (1, 1))
    bounds = np.zeros((2, model.PARAMETERS))
    half = np.array([-np.pi / 2, np.pi / 2])
    bounds[:, model.RADIUS], bounds[:, model.ASPECT] = population.radius_m, population.aspect
    bounds[:, model.SPEED], bounds[:, model.TURN] = speed, turn
    bounds[1, model.TURN] += 1  # its whole part is the step
    bounds[:, [model.HEADING, model.FIRST_BOUNCE, model.NEXT_BOUNCE]] = half[:, None]
    bounds[:, [model.BEARING, model.NEXT_BEARING]] = 2 * half[:, None]
    return bounds


def _explains(seen: Seen, each: Inferred, hits: np.ndarray) -> np.ndarray:
    """Return which hits lie on the outlines of most particles."""
    places = (seen.steps[hits], seen.points[hits])
    return model.near(each.particles, seen.motion(each.reference), places, EXPLAINED_M, len(seen.scans[0])) > 0.5
