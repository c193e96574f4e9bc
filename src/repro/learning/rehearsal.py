"""Windows of simulated worlds in which a network rehearses while it adapts to logs, see `adaptation`."""

import numpy as np

from repro.learning.labels import UNKNOWN, Labeled, drawn
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

WORLDS = (("places", "crowds"), ("rooms", "crossing"))  # and their experiments, in turn: with walls, and open
SHARE = 0.4  # of the windows of logs


def rehearsed(predictor: Predictor, windows_of_logs: int) -> Labeled:
    """Record a window in each of some worlds, with the robot in the middle of its map.

    Args:
        predictor: encoding and grid.
        windows_of_logs: number of windows of logs; of simulated ones there are `SHARE` as many.
    """
    specs = [
        world_spec(read_world(conf_directory() / "world" / f"{name}.yaml"), experiment) for name, experiment in WORLDS
    ]
    windows, labels = list[Scans](), list[np.ndarray]()
    for seed in progress(range(round(SHARE * windows_of_logs)), "recording simulated worlds"):
        spec = specs[seed % len(specs)]
        scans, codes = _window(simulate(sample_world(spec, seed)), spec, predictor.grid)
        windows.append(scans)
        labels.append(codes)
    return drawn(windows, labels, predictor)


def _window(recording: Recording, spec: WorldSpec, grid: Grid) -> tuple[Scans, np.ndarray]:
    """Return a recording on the map around its last pose, and the labels of the map, (H, W)."""
    scans = recording.scans
    origin = scans.poses[-1, :2] - grid.size_m / 2
    window = on_map(scans.ranges, scans.angles, scans.poses, origin)
    free, still = (true_map(recording, origin, grid, which) for which in (slice(None), standing(recording.states)))
    shown = shown_pixels(still[None], window.poses[-1:], grid)[0]
    centers = grid.centers().reshape(*shown.shape, 2) + origin
    is_outside = ((centers < 0) | (centers > [spec.world.width, spec.world.height])).any(-1)
    return window, np.where(is_outside, UNKNOWN, free + HIDDEN * ~shown)


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
