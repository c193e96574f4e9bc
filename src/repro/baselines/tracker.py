"""A classical tracker: discs and rectangles with constant velocity, fitted to clusters of hits in space and time.

Close hits belong to one cluster. To each cluster a disc and a rectangle are fitted (`fitting`), and the one that costs
less is kept; two clusters are joined where one shape explains both. The cost is the mean squared distance of the
hits to the outline, that of the lines of sight just past them to the silhouette, and a prior of size, aspect and speed.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from repro.baselines import fitting
from repro.maps.grid import Grid
from repro.scans import Scans

EVERY = 2  # steps from one used scan to the next; the paper's obstacles move at most 0.14 m in between
FEWEST, MOST = 8, 30  # hits of a cluster: fewer are ignored, of more an even selection is used
CLUSTER_M_S = 1.0  # hits that are a second apart in time count as this far apart in space
EDGE_M = 0.5  # a beam passes an obstacle if it ends at least this far behind the hit beside it
NOISE_M = 0.05  # see `fitting.fit`; only its ratios to the spreads of the prior and to `join` matter
SPREAD_LOG_ASPECT = 0.2
STARTS = [(True, 0.0), *product([False], np.arange(4) * np.pi / 4)]  # fits: whether of a disc, heading at the start


@dataclass(frozen=True)
class Prior:
    """What is known of the obstacles: the settings of the fits.

    Args:
        radius_m: mean radius.
        spread_m: standard deviation of the radius.
        aspect: mean length over width of the rectangles.
        speed_m_s: standard deviation of each component of the velocity.
        join: by how much the cost may rise when two clusters become one.
    """

    radius_m: float
    spread_m: float
    aspect: float
    speed_m_s: float
    join: float


@dataclass(frozen=True, eq=False)
class Cluster:
    """Hits of one obstacle: x, y [m], time [s], cosine, sine of the beam, (H, 5), and edges, see `fitting.fit`."""

    hits: np.ndarray
    edges: np.ndarray

    @cached_property
    def mean_s(self) -> np.floating:
        """The mean time of the hits [s]."""
        return self.hits[:, 2].mean()


@dataclass(frozen=True, eq=False)
class Track:
    """A fitted obstacle: its state, see `fitting`, the cost of the fit, and the time since its last hit [s]."""

    state: np.ndarray
    is_disc: bool
    cost: float
    age_s: float


def clusters(scans: Scans, step_s: float, near_m: float) -> list[Cluster]:
    """Cluster the hits of a window, arrays (T, N); hits closer than `near_m` [m] belong together."""
    chosen = slice((len(scans.ranges) - 1) % EVERY, None, EVERY)  # includes the last step
    scans = Scans(scans.ranges[chosen], scans.angles.astype(float), scans.poses[chosen].astype(float))
    points, hit = scans.points()
    step, beam = np.nonzero(hit)
    if not len(step):
        return []
    time = step_s * EVERY * (step - len(scans.ranges) + 1)
    bearing = scans.poses[step, 2] + scans.angles[beam]
    hits = np.column_stack([points[hit], time, np.cos(bearing), np.sin(bearing)])
    pairs = KDTree(hits[:, :3] * [1, 1, CLUSTER_M_S]).query_pairs(near_m, output_type="ndarray")
    close = coo_array((np.ones(len(pairs), dtype=bool), pairs.T), (len(hits), len(hits)))
    number, labels = connected_components(close, directed=False)
    members = (np.flatnonzero(labels == label) for label in range(number))
    return [Cluster(hits[own], _edges(scans, step[own], beam[own], time[own])) for own in members if len(own) >= FEWEST]


def track(found: list[Cluster], prior: Prior) -> list[Track]:
    """Fit a shape to every cluster, and join pairs that one shape explains, those of early clusters first."""
    fitted = [(cluster, _fit(cluster, prior)) for cluster in found]
    tried: set[tuple[Cluster, Cluster]] = set()
    while pairs := [pair for pair in combinations(fitted, 2) if (pair[0][0], pair[1][0]) not in tried]:
        for (first, one), (second, other) in pairs:
            tried.add((first, second))
            if not _is_near(first, one, second, other):
                continue
            both = Cluster(np.concatenate([first.hits, second.hits]), np.concatenate([first.edges, second.edges]))
            joined = _fit(both, prior)
            if joined.cost <= one.cost + other.cost + prior.join:
                fitted = [(c, t) for c, t in fitted if c is not first and c is not second] + [(both, joined)]
                break
    return [fit for _, fit in fitted]


def distances(tracks: list[Track], grid: Grid, coast_s: float, ahead_s: float = 0.0) -> np.ndarray:
    """Return the distance of each pixel to the nearest outline [m], negative inside, (H, W).

    A track moves on for at most `coast_s` [s] after its last hit, since obstacles turn. The map is that of the last
    step, or of the time `ahead_s` [s] after it.
    """
    nearest = np.full((grid.size_px, grid.size_px), fitting.FARTHEST_M, dtype=np.float32)
    for found in tracks:
        state = found.state.copy()
        state[:2] += state[2:4] * (min(found.age_s + ahead_s, coast_s) - found.age_s)
        fitting.draw(nearest, grid.resolution_m, state, found.is_disc)
    return nearest


def _edges(scans: Scans, step: np.ndarray, beam: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the lines of sight between the outermost beams of a cluster's hits and the next beams, which pass it."""
    edges = []
    for now in np.unique(step):
        own = beam[step == now]
        for outermost, side in ((own.min(), 1), (own.max(), -1)):
            beside = outermost - side
            inside = 0 <= beside < len(scans.angles)
            if inside and scans.ranges[now, beside] > scans.ranges[now, outermost] + EDGE_M:
                bearing = scans.poses[now, 2] + (scans.angles[outermost] + scans.angles[beside]) / 2
                when = time[step == now][0]
                edges.append((*scans.poses[now, :2], when, np.cos(bearing), np.sin(bearing), side))
    return np.array(edges).reshape(-1, 6)


def _is_near(first: Cluster, one: Track, second: Cluster, other: Track) -> bool:
    """Return whether two tracks overlap halfway between the mean times of their hits."""
    when = (first.mean_s + second.mean_s) / 2
    apart = one.state[:2] - other.state[:2] + when * (one.state[2:4] - other.state[2:4])
    return bool(np.hypot(*apart) < one.state[4] + other.state[4])


def _fit(cluster: Cluster, prior: Prior) -> Track:
    """Fit a disc and rectangles of several headings to a cluster; return the one that costs least."""
    hits, edges = (np.ascontiguousarray(points[:: len(points) // MOST + 1]) for points in (cluster.hits, cluster.edges))
    mean, time = hits[:, 2].mean(), hits[:, 2] - hits[:, 2].mean()
    behind = hits[:, :2] + prior.radius_m * hits[:, 3:]  # a center for each hit
    velocity = time @ (behind - behind.mean(0)) / (time @ time + 5.0)
    start = [*(behind.mean(0) - mean * velocity), *velocity, prior.radius_m, np.log(prior.aspect)]
    known = (NOISE_M, prior.radius_m, prior.spread_m, np.log(prior.aspect), SPREAD_LOG_ASPECT, prior.speed_m_s)
    age_s = -cluster.hits[:, 2].max()
    fits = []
    for is_disc, heading in STARTS:
        state, cost = fitting.fit(np.array([*start, heading]), is_disc, hits, edges, np.array(known))
        fits.append(Track(state, is_disc, cost, age_s))
    return min(fits, key=lambda fit: fit.cost)
