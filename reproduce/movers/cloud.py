"""A classical memory of movers: each cluster of hits that moves becomes a cloud of particles.

The particles of a cloud keep their velocities and sometimes turn, so that it grows while its mover is not hit. Those
that a beam passes over, or that run into what stands, nearly vanish. A cluster of hits belongs to the cloud that
expects it most, or begins a new one. The map has a disc of an assumed radius around each particle.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from repro.maps.grid import Grid
from repro.maps.visibility import newest_visible
from repro.scans import Scans

PARTICLES, CLOUDS = 200, 30  # per cloud; clouds of a window, of which the least certain are dropped
DEPTH = 0.8  # of a center behind the mean of its hits, in radii
JITTER_M = 0.02  # of particles that are drawn again; of their velocities in m/s
MISSED = 0.03  # of a particle that a beam passes over or that runs into a wall
SMOOTH = 0.2  # standard deviation of the blur of a cloud, over that of its particles
LEAST = 0.02  # probability that a cloud still has its mover


@dataclass(frozen=True)
class CloudSettings:
    """What is assumed of movers, and tuned on validation worlds.

    Args:
        radius_m: radius of the disc [m].
        speed_m_s: top speed [m/s]; new clouds have all speeds up to it.
        turn_s: mean time between two turns [s].
        turn_rad: standard deviation of a turn [rad].
        stop_share: share of the turns that are a stop.
        survival_s: mean time for which a cloud keeps a mover that is not hit [s].
        place_m: standard deviation of the place of a cluster [m].
        extent_m: largest extent of a cluster of hits on a mover [m].
        passed_share: least share of its hits where beams passed at another time.
        least_width: least width of a cluster as the lidar sees it, over the diameter of the disc.
        gap_m: distance of two hits beside one another that divides clusters [m].
        birth: density of new movers [1/m^2], with which the clouds compete for a cluster.
    """

    radius_m: float = 0.27
    speed_m_s: float = 1.2
    turn_s: float = 4.0
    turn_rad: float = 2.0
    stop_share: float = 0.0
    survival_s: float = 20.0
    place_m: float = 0.08
    extent_m: float = 0.9
    passed_share: float = 0.1
    least_width: float = 0.4
    gap_m: float = 0.4
    birth: float = 0.02


@dataclass(frozen=True)
class Clusters:
    """Clusters of hits of all scans of a window, C.

    Args:
        step: the step of each, from 0, (C,).
        center: x, y of the disc that they are of [m], (C, 2).
        moves: whether they are of a mover, bool, (C,).
        stands: flat pixels of the hits of the others, which are obstacles that stand.
    """

    step: np.ndarray
    center: np.ndarray
    moves: np.ndarray
    stands: np.ndarray


def cloud_map(scans: Scans, grid: Grid, settings: CloudSettings, step_s: float, range_max_m: float) -> np.ndarray:
    """Return how much of the clouds is at each pixel at the last step of a window, in [0, 1], (H, W).

    Args:
        scans: the window, (T, N), on the map.
        grid: grid of the map.
        settings: what is assumed of movers.
        step_s: time of a step [s].
        range_max_m: maximum range of the lidar [m].
    """
    found, is_new = clusters(scans, grid, settings, range_max_m), new_scans(scans)
    clouds = Clouds(settings, step_s, grid, found.stands)
    for step in range(int(found.step[found.moves].min(initial=len(is_new))), len(is_new)):
        clouds.predict()
        if is_new[step]:
            clouds.see(scans.ranges[step], scans.angles, scans.poses[step])
            clouds.take(found.center[(found.step == step) & found.moves])
    return clouds.draw()


def new_scans(scans: Scans) -> np.ndarray:
    """Return the steps of a window with a scan of their own, bool, (T,).

    Where several steps have one scan, since scans are rarer, it belongs to the middle one, or to the end of the window.
    """
    values = np.nan_to_num(scans.ranges, nan=-1.0)
    end = np.flatnonzero(np.append((values[1:] != values[:-1]).any(1), True))
    begin = np.append(0, end[:-1] + 1)
    is_new = np.zeros(len(values), bool)
    is_new[np.append((begin[:-1] + end[:-1]) // 2, end[-1])] = True
    return is_new


def clusters(scans: Scans, grid: Grid, settings: CloudSettings, range_max_m: float) -> Clusters:
    """Divide the hits of each scan of a window, (T, N), into clusters."""
    points, hit = scans.points()
    step, beam = np.nonzero(hit)
    if not len(step):
        return Clusters(step, np.zeros((0, 2)), np.zeros(0, bool), step)
    points, bearing = points[hit], scans.poses[step, 2] + scans.angles[beam]
    apart = np.linalg.norm(np.diff(points, axis=0), axis=-1) > settings.gap_m
    begin = np.flatnonzero(np.concatenate([[True], apart | (np.diff(step) > 0)]))
    size = np.diff([*begin, len(step)])
    extent = np.linalg.norm(points[begin + size - 1] - points[begin], axis=-1)
    width = size * (scans.angles[1] - scans.angles[0]) * np.minimum.reduceat(scans.ranges[hit], begin)
    pixel = _pixels(points, grid)
    first, last = (of_pixels.ravel()[pixel] for of_pixels in passes(scans, grid, range_max_m))
    is_passed = (pixel >= 0) & ((first < step + 1) | (last > step + 1))
    moves = (extent <= settings.extent_m) & (width >= settings.least_width * 2 * settings.radius_m)
    moves &= np.add.reduceat(is_passed, begin) / size >= settings.passed_share
    behind = points + DEPTH * settings.radius_m * np.stack([np.cos(bearing), np.sin(bearing)], -1)
    center = np.add.reduceat(behind, begin) / size[:, None]
    stands = np.unique(pixel[(pixel >= 0) & np.repeat(~moves, size)])
    return Clusters(step[begin], center, moves, stands)


def passes(scans: Scans, grid: Grid, range_max_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the last step, from 1, at which a beam passed over each pixel, (H, W), both.

    A pixel without a pass has the number of steps plus one, and 0.
    """
    last = _last_passed(scans, grid, range_max_m)
    back = _last_passed(Scans(scans.ranges[::-1], scans.angles, scans.poses[::-1]), grid, range_max_m)
    return len(scans.poses) + 1 - back, last


def _last_passed(scans: Scans, grid: Grid, range_max_m: float) -> np.ndarray:
    """Return the last step at which a beam passed at least a pixel before its end, (H, W)."""
    return newest_visible(scans.batched(), grid, range_max_m, margin_m=-grid.resolution_m)[0]


class Clouds:
    """Clouds of particles, K x P.

    Args:
        settings: what is assumed of movers.
        step_s: time of a step [s].
        grid: grid of the map.
        stands: flat pixels of what stands.
    """

    def __init__(self, settings: CloudSettings, step_s: float, grid: Grid, stands: np.ndarray) -> None:
        self.settings, self.step_s, self.grid = settings, step_s, grid
        self.walls = np.zeros(grid.size_px**2 + 1, bool)  # the last one is off the map
        self.walls[stands] = True
        self.rng = np.random.default_rng(0)
        self.place = self.velocity = np.zeros((0, PARTICLES, 2))
        self.weight = np.zeros((0, PARTICLES))  # sums to 1 in each cloud
        self.exists = np.zeros(0)

    def predict(self) -> None:
        """Move the particles by a step."""
        own = self.settings
        self.place = self.place + self.velocity * self.step_s
        turns = self.rng.random(self.weight.shape) < self.step_s / own.turn_s
        if count := int(turns.sum()):
            velocity = self.velocity[turns]
            ahead = np.where(
                (velocity == 0).all(-1), self.rng.uniform(-np.pi, np.pi, count), np.arctan2(*velocity.T[::-1])
            )
            heading = ahead + self.rng.normal(0, own.turn_rad, count)
            speed = np.linalg.norm(velocity, axis=-1)
            speed = np.where(speed == 0, self.rng.uniform(0, own.speed_m_s, count), speed)
            speed *= self.rng.random(count) >= own.stop_share
            self.velocity = self.velocity.copy()
            self.velocity[turns] = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
        self.exists = self.exists * np.exp(-self.step_s / own.survival_s)

    def see(self, ranges: np.ndarray, angles: np.ndarray, pose: np.ndarray) -> None:
        """Weaken particles that beams passed over and those in walls, and drop clouds that have lost their movers."""
        offset = self.place - pose[:2]
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) - pose[2] - angles[0]
        beam = np.rint(((bearing + np.pi) % (2 * np.pi) - np.pi) / (angles[1] - angles[0])).astype(int)
        inside = (beam >= 0) & (beam < len(angles))
        reading = ranges[np.where(inside, beam, 0)]
        wrong = inside & (reading > np.linalg.norm(offset, axis=-1))  # false for NaN
        wrong |= self.walls[_pixels(self.place, self.grid)]
        self.weight = self.weight * np.where(wrong, MISSED, 1.0)
        left = self.weight.sum(1)
        self.weight /= left[:, None]
        self.exists = self.exists * left / (self.exists * left + 1 - self.exists)
        self._keep(self.exists >= LEAST)

    def take(self, centers: np.ndarray) -> None:
        """Give each cluster, x, y [m], (C, 2), to the cloud that expects it most, or to a new one."""
        variance, reach_m = self.settings.place_m**2, 4 * self.settings.place_m
        low, high = self.place.min(1)[:, None] - reach_m, self.place.max(1)[:, None] + reach_m
        cloud, cluster = np.nonzero(((centers >= low) & (centers <= high)).all(-1))  # pairs, Q
        x, y = np.moveaxis(self.place[cloud] - centers[cluster, None], -1, 0)
        joint = self.weight[cloud] * np.exp(-(x * x + y * y) / (2 * variance)) / (2 * np.pi * variance)  # (Q, P)
        expected = joint.sum(1) * self.exists[cloud]
        born = np.ones(len(centers), bool)
        while expected.max(initial=0) > self.settings.birth:
            pair = int(expected.argmax())
            own = cloud[pair]
            drawn = self.rng.choice(PARTICLES, PARTICLES, p=joint[pair] / joint[pair].sum())
            self.place[own] = self.place[own, drawn] + self.rng.normal(0, JITTER_M, (PARTICLES, 2))
            self.velocity[own] = self.velocity[own, drawn] + self.rng.normal(0, JITTER_M, (PARTICLES, 2))
            self.weight[own], self.exists[own], born[cluster[pair]] = 1 / PARTICLES, 1.0, False
            expected[(cloud == own) | (cluster == cluster[pair])] = 0
        self._begin(centers[born])

    def draw(self) -> np.ndarray:
        """Return the probability that a disc around a particle covers each pixel, (H, W)."""
        size, radius_px = self.grid.size_px, self.settings.radius_m / self.grid.resolution_m
        if not len(self.exists):
            return np.zeros((size, size))
        pixel, base = _pixels(self.place, self.grid), np.arange(len(self.exists))[:, None] * (size**2 + 1)
        pixel = np.where(pixel < 0, size**2, pixel) + base
        share = np.bincount(pixel.ravel(), self.weight.ravel(), len(self.exists) * (size**2 + 1))
        share = share.reshape(-1, size**2 + 1)[:, :-1].reshape(-1, size, size)
        reach = int(np.ceil(radius_px)) + 1
        away = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
        disc = np.clip(radius_px + 0.5 - away, 0, 1)[None]
        spread = SMOOTH * np.sqrt(self.place.var(1).mean(-1)) / self.grid.resolution_m
        smooth = [gaussian_filter(own, sigma) for own, sigma in zip(share, spread, strict=True)]
        covered = np.clip(fftconvolve(np.stack(smooth), disc, mode="same", axes=(1, 2)), 0, 1)
        return 1 - np.prod(1 - self.exists[:, None, None] * covered, axis=0)

    def _begin(self, centers: np.ndarray) -> None:
        shape = (len(centers), PARTICLES)
        heading, speed = self.rng.uniform(-np.pi, np.pi, shape), self.rng.uniform(0, self.settings.speed_m_s, shape)
        velocity = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], -1)
        place = centers[:, None] + self.rng.normal(0, self.settings.place_m, (*shape, 2))
        self.place, self.velocity = np.concatenate([self.place, place]), np.concatenate([self.velocity, velocity])
        self.weight = np.concatenate([self.weight, np.full(shape, 1 / PARTICLES)])
        self.exists = np.concatenate([self.exists, np.full(len(centers), 0.9)])
        if len(self.exists) > CLOUDS:
            self._keep(np.argsort(-self.exists, kind="stable")[:CLOUDS])

    def _keep(self, which: np.ndarray) -> None:
        self.place, self.velocity = self.place[which], self.velocity[which]
        self.weight, self.exists = self.weight[which], self.exists[which]


def _pixels(points: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the flat pixel of places x, y [m], (..., 2), -1 off the map."""
    column, up = np.moveaxis(np.floor(points / grid.resolution_m), -1, 0)
    inside = (column >= 0) & (column < grid.size_px) & (up >= 0) & (up < grid.size_px)
    return np.where(inside, (grid.size_px - 1 - up) * grid.size_px + column, -1).astype(int)
