"""Recordings of worlds with movers, and where each mover can be: what a map is asked about."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from scipy.ndimage import maximum_filter
from tqdm import tqdm

from repro.evaluation.recency import TOUCH_M
from repro.learning.rehearsal import true_map
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.grid import Grid
from repro.maps.outlines import placed
from repro.prediction.agreement import last_hits
from repro.prediction.windows import Window, cut, on_map
from repro.scans import Scans
from repro.simulation.raycasting import scan
from repro.simulation.sampling import sample_world
from repro.simulation.sensing import sensed
from repro.simulation.simulator import Recording, simulate
from repro.system.project import conf_directory
from repro.worlds.spec import WorldSpec, read_world, world_spec

SLACK_M = 0.2  # of a region: one pixel at 25 m and 128 px
BINS = ("0", "1-5", "6-10", "11-20", "21-40", "41-99")  # scans since the last hit
LATER = (1, 6, 11, 21, 41)  # first scans of the bins after the first one


@dataclass(frozen=True)
class Place:
    """Worlds in which movers are measured.

    Args:
        world: name of the file in conf/world.
        experiment: name of the experiment in it.
        centered: whether the map has the robot in its middle, or lies as the world, as in the study.
    """

    world: str
    experiment: str
    centered: bool = True

    @property
    def name(self) -> str:
        return f"{self.world} {self.experiment}"

    @property
    def spec(self) -> WorldSpec:
        """What decides the worlds."""
        return world_spec(read_world(conf_directory() / "world" / f"{self.world}.yaml"), self.experiment)

    @property
    def top_m_s(self) -> float:
        """Top speed of the movers [m/s]."""
        return max(behavior.speed_m_s[1] for behavior in self.spec.behaviors)


PLACES = (
    Place("rooms", "people"),
    Place("rooms", "crossing"),
    Place("places", "people"),
    Place("paper", "3", centered=False),
    Place("paper", "4", centered=False),
)


@dataclass(frozen=True)
class Mover:
    """A mover that was hit in a window.

    Args:
        number: of the obstacle in its world.
        since: scans since its last hit; 0 if the last scan hits it.
        last: its place at its last hit, x, y [m] on the map.
        reach_m: how far from there its outline can be at the end [m].
    """

    number: int
    since: int
    last: np.ndarray
    reach_m: float


@dataclass(frozen=True)
class Scene:
    """A recording as a user has it, and what is true at its end.

    Args:
        seed: of the world.
        window: the window on the map.
        recording: the recording with its obstacles.
        moves: which of them move, bool, (O,).
        movers: those that were hit.
        without_movers: the window as it were without movers; None in worlds where nothing stands.
        range_max_m: maximum range of the lidar [m].
        step_s: time of a step [s].
    """

    seed: int
    window: Window
    recording: Recording
    moves: np.ndarray
    movers: tuple[Mover, ...]
    without_movers: Scans | None
    range_max_m: float
    step_s: float


@dataclass(frozen=True)
class Target:
    """What is asked of a mover: pixels of a map, each bool, (H, W).

    Args:
        mover: the mover.
        region: where it can be.
        taken: pixels of the region that it or another mover takes.
        body: where it is; no pixel if it has left the map.
    """

    mover: Mover
    region: np.ndarray
    taken: np.ndarray
    body: np.ndarray


def scenes(place: Place, seeds: range, size_m: float) -> Iterator[Scene]:
    """Yield the recording of each world, the robot in its direction 1, on maps of a size [m]."""
    spec, top_m_s = place.spec, place.top_m_s
    center: Any = "robot" if place.centered else (spec.world.width / 2, spec.world.height / 2)
    settings = WindowSettings(center, spec.steps, spec.world.step_time)
    for seed in tqdm(seeds, place.name, disable=None, leave=False):
        yield _scene(spec, seed, settings, size_m, top_m_s)


def _scene(spec: WorldSpec, seed: int, settings: WindowSettings, size_m: float, top_m_s: float) -> Scene:
    world = sample_world(spec, seed)
    recording, range_max_m, step_s = simulate(world), spec.lidar.range_max, spec.world.step_time
    moves = np.array(["behavior" in obstacle for obstacle in world["obstacle"]])
    touched = touches(recording, np.flatnonzero(moves), TOUCH_M + 3 * (spec.lidar.std or 0.0))

    def received(ranges: np.ndarray) -> Scans:
        """Return a window as the sensors of this seed give it, whatever its ranges."""
        exact, rng = replace(recording.scans, ranges=ranges), np.random.default_rng([seed, 0])
        return sensed(exact, spec.sensing, range_max_m, rng) if spec.sensing else exact

    hits = [np.isfinite(received(np.where(own, recording.scans.ranges, np.inf)).ranges).any(1) for own in touched]
    scans = received(recording.scans.ranges)
    log = ScanLog(step_s * np.arange(spec.steps), scans.ranges, scans.angles, scans.poses, range_max_m=range_max_m)
    (window,) = (each for each in cut(log, settings, 1.0, size_m) if isinstance(each, Window))
    movers = tuple(_movers(recording, np.flatnonzero(moves), hits, np.array(window.origin), top_m_s * step_s))
    without = None
    if not moves.all():
        standing = recording.outlines[~moves], recording.states[~moves]
        ranges, _ = scan(recording.scans.poses, recording.scans.angles, *standing, range_max_m)
        seen = received(ranges)
        without = on_map(seen.ranges, seen.angles, seen.poses, np.array(window.origin))
    return Scene(seed, window, recording, moves, movers, without, range_max_m, step_s)


def touches(recording: Recording, numbers: np.ndarray, reach_m: float) -> np.ndarray:
    """Return which beams end on each of some obstacles, at most `reach_m` from its outline [m], bool, (M, T, N)."""
    points, hit = recording.scans.points()
    touched = np.zeros((len(numbers), *hit.shape), dtype=bool)
    for own, number in zip(touched, numbers, strict=True):
        states, outline = recording.states[number], recording.outlines[number]
        near = np.linalg.norm(outline, axis=-1).max() + reach_m
        step, beam = np.nonzero(hit & (np.linalg.norm(points - states[:, None, :2], axis=-1) <= near))
        shapes = shapely.polygons(placed(outline[None], states[step]))
        own[step, beam] = shapely.dwithin(shapes, shapely.points(points[step, beam]), reach_m)
    return touched


def _movers(
    recording: Recording, numbers: np.ndarray, hits: list[np.ndarray], origin: np.ndarray, step_m: float
) -> Iterator[Mover]:
    """Yield the movers that were hit, (T,) for each, of which the fastest go `step_m` in a step [m]."""
    for number, steps in zip(numbers, hits, strict=True):
        if steps.any():
            last = int(np.flatnonzero(steps)[-1])
            since = len(steps) - 1 - last
            radius_m = float(np.linalg.norm(recording.outlines[number], axis=-1).max())
            place = recording.states[number, last, :2] - origin
            yield Mover(int(number), since, place, radius_m + SLACK_M + step_m * since)


def targets(scene: Scene, grid: Grid) -> list[Target]:
    """Return what is asked of each mover on the map, those hit last first.

    A pixel belongs to the region of the mover that was hit last among those that can be there. So no pixel counts
    twice, and the sum of the probabilities of a calibrated map is the area that movers take, those that were never hit
    included. A region lacks what stands, with the pixels beside it, and what the robot would not have seen without
    movers, since something that stands may be there.
    """
    origin = np.array(scene.window.origin)
    bodies = {
        number: true_map(scene.recording, origin, grid, np.array([number])) == 0
        for number in np.flatnonzero(scene.moves).tolist()
    }
    covered = np.any([*bodies.values()], axis=0)
    left = np.ones_like(covered)
    if scene.without_movers is not None:
        stands = true_map(scene.recording, origin, grid, ~scene.moves) == 0
        left = last_hits(scene.without_movers, grid, scene.range_max_m)[1] & ~maximum_filter(stands, 3)
    found = []
    for mover in sorted(scene.movers, key=lambda mover: mover.since):
        region = within(grid, mover.last, mover.reach_m) & left
        left = left & ~region
        found.append(Target(mover, region, covered & region, bodies[mover.number]))
    return found


def within(grid: Grid, center: np.ndarray, radius_m: float) -> np.ndarray:
    """Return the pixels with a center at most `radius_m` from a place x, y [m], bool, (H, W)."""
    middle = grid.resolution_m * (np.arange(grid.size_px) + 0.5)
    return (middle - center[0]) ** 2 + (middle[::-1, None] - center[1]) ** 2 <= radius_m**2


def bin_of(since: int) -> int:
    """Return the index in `BINS` of a number of scans since the last hit."""
    return int(np.digitize(since, LATER))
