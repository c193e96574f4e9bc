"""Windows of simulated worlds in which a network rehearses while it adapts to logs, see `adaptation`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from repro.learning.labels import MOVER, UNKNOWN, Labeled, drawn
from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.maps.outlines import standing
from repro.maps.visibility import shown_pixels
from repro.networks.predictor import Predictor
from repro.prediction.windows import on_map
from repro.recordings.datasets import HIDDEN
from repro.scans import Scans
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import Recording, simulate
from repro.system.progress import progress
from repro.system.project import conf_directory
from repro.worlds.spec import WorldSpec, read_world, world_spec

WORLDS = {  # and their experiments: how many of six windows each has; the first two have walls, the last is open
    ("places", "crowds"): 1,
    ("places", "people"): 2,
    ("rooms", "crossing"): 3,
}
SHARES = (0.4, 1.0)  # of the windows of logs, in each round of an adaptation
ATTEMPTS = 4  # recordings of an open world; the first in which somebody has just left the view is taken
LATELY_STEPS = 20  # in which a mover that counts was in view
SLACK_M = 0.5  # added to the distance that a mover can have covered


@dataclass(frozen=True)
class SeenMover:
    """An obstacle that moves and was in view lately.

    Args:
        place: where it was in view last, x, y [m].
        reach_m: how far from there it can be at the end [m].
        is_lost: whether it is not in view at the end.
    """

    place: np.ndarray
    reach_m: float
    is_lost: bool


def rehearsed(predictor: Predictor, windows_of_logs: int) -> Iterator[Labeled]:
    """Record windows for each round of an adaptation, `SHARES` as many as there are of logs.

    Args:
        predictor: encoding and grid.
        windows_of_logs: number of windows of logs.
    """
    for share in SHARES:
        yield recorded(predictor, round(share * windows_of_logs))


def recorded(predictor: Predictor, count: int) -> Labeled:
    """Record a window in each of so many worlds, with the robot in the middle of its map."""
    specs = [spec for (name, experiment), number in WORLDS.items() for spec in [_spec(name, experiment)] * number]
    windows, labels = list[Scans](), list[np.ndarray]()
    for seed in progress(range(count), "recording simulated worlds"):
        spec = specs[seed % len(specs)]
        recording = _recorded(spec, range(seed, seed + ATTEMPTS * count, count))
        scans, codes = _window(recording, spec, predictor.grid)
        windows.append(scans)
        labels.append(codes)
    return drawn(windows, labels, predictor)


def _spec(name: str, experiment: str) -> WorldSpec:
    return world_spec(read_world(conf_directory() / "world" / f"{name}.yaml"), experiment)


def _recorded(spec: WorldSpec, seeds: range) -> Recording:
    """Record a world; without standing obstacles, take the first of these seeds in which somebody has left the view.

    The scans show who has left the view, so this choice hardly changes the probability of people given the scans.
    """
    for seed in seeds:
        recording = simulate(sample_world(spec, seed))
        if standing(recording.states).any() or any(mover.is_lost for mover in _seen(recording, spec)):
            break
    return recording


def _seen(recording: Recording, spec: WorldSpec) -> Iterator[SeenMover]:
    """Yield each obstacle that moves and was in view lately."""
    poses, states = recording.scans.poses[-LATELY_STEPS:], recording.states[:, -LATELY_STEPS:, :2]
    offsets = states - poses[:, :2]
    bearings = np.arctan2(offsets[..., 1], offsets[..., 0]) - poses[:, 2]
    in_view = np.cos(bearings) >= math.cos(spec.lidar.angle_range / 2)
    in_view &= np.linalg.norm(offsets, axis=-1) <= spec.lidar.range_max
    top_m_s = max((behavior.speed_m_s[1] for behavior in spec.behaviors), default=0.0)
    for number in np.flatnonzero(in_view.any(1) & ~standing(recording.states)):
        last = int(np.flatnonzero(in_view[number])[-1])
        since = len(poses) - 1 - last
        radius_m = float(np.linalg.norm(recording.outlines[number], axis=-1).max())
        yield SeenMover(states[number, last], radius_m + top_m_s * since * spec.world.step_time + SLACK_M, since > 0)


def _window(recording: Recording, spec: WorldSpec, grid: Grid) -> tuple[Scans, np.ndarray]:
    """Return a recording on the map around its last pose, and the labels of the map, (H, W)."""
    scans = recording.scans
    origin = scans.poses[-1, :2] - grid.size_m / 2
    window = on_map(scans.ranges, scans.angles, scans.poses, origin)
    free, still = (true_map(recording, origin, grid, which) for which in (slice(None), standing(recording.states)))
    shown = shown_pixels(still[None], window.poses[-1:], grid)[0]
    centers = grid.centers().reshape(*shown.shape, 2) + origin
    is_outside = ((centers < 0) | (centers > [spec.world.width, spec.world.height])).any(-1)
    near = np.zeros_like(shown)
    for seen in _seen(recording, spec):
        near |= np.linalg.norm(centers - seen.place, axis=-1) <= seen.reach_m
    return window, np.where(is_outside, UNKNOWN, free + HIDDEN * ~shown + MOVER * near)


def true_map(
    recording: Recording, origin: np.ndarray, grid: Grid, which: np.ndarray | slice = slice(None)
) -> np.ndarray:
    """Return the map of some obstacles after the last step, 1 is free, uint8, (H, W).

    Args:
        recording: the recording.
        origin: x, y of the lower left corner of the map [m].
        grid: grid of the map.
        which: the obstacles.
    """
    states = recording.states[which, -1] - [*origin, 0]
    return rasterize(recording.outlines[which], states, np.zeros(len(states), int), 1, grid)[0]
