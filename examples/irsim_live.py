"""A robot in IR-SIM with the predicted map beside the true one, live or as a GIF.

python examples/irsim_live.py --exp 4 --seed 1 --save live.gif

The robot repeats the motion of an experiment of the paper; from its 100th scan on, a map is predicted for every scan.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.collections import LineCollection

from repro.maps.grid import Grid
from repro.maps.ground_truth import rasterize
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.drawing import shade
from repro.prediction.stream import PredictionStream
from repro.prediction.stream_map import StreamMap
from repro.recordings.format import SHOWN_SEED
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import make, outlines_of_world
from repro.worlds.robot_motions import drive_of
from repro.worlds.spec import read_world, world_spec

ROOT = Path(__file__).parents[1]
WEIGHTS = {  # by experiment, below reproduce/results
    "1": "workstation/exp1-convgru",
    "2": "workstation/exp2-convgru",
    "3": "workstation-16000/exp3-convgru",
    "4": "workstation-16000/exp4-convgru",
}


@dataclass(frozen=True)
class Frame:
    """One step: true map (H, W), 1 is free; prediction; pose (3,); scan ranges (N,) [m]; time [ms]."""

    step: int
    truth: np.ndarray
    predicted: StreamMap | None
    pose: np.ndarray
    ranges: np.ndarray
    latency_ms: float


def true_map(env: Any, outlines: np.ndarray, grid: Grid) -> np.ndarray:
    """Draw the obstacles of an environment, given their outlines (O, V, 2), (H, W), 1 is free."""
    states = np.array([obstacle.state[:3, 0] for obstacle in env.obstacle_list])
    return rasterize(outlines, states, np.zeros(len(states), int), 1, grid)[0]


def drive(env: Any, outlines: np.ndarray, predictor: Predictor, options: argparse.Namespace) -> Iterator[Frame]:
    """Step an environment, and predict after every step."""
    robot, center_m = env.robot, predictor.grid.size_m / 2
    stream = PredictionStream(
        predictor, np.array(robot.lidar.angle_list), center=(center_m, center_m), step_s=env.step_time
    )
    commands = drive_of(robot.obj_behavior.behavior_dict).commands(env.step_time)
    for step in range(options.steps):
        env.step(commands[step % len(commands)])
        ranges = np.where(robot.lidar.valid, robot.lidar.range_data, np.inf)
        pose, begin = robot.state[:3, 0].copy(), time.perf_counter()
        predicted = stream.update(ranges, pose, step * env.step_time)
        latency_ms = 1e3 * (time.perf_counter() - begin)
        yield Frame(step, true_map(env, outlines, predictor.grid), predicted, pose, ranges, latency_ms)


class View:
    """A figure with the true and the predicted map."""

    def __init__(self, angles: np.ndarray, size_m: float) -> None:
        self.angles = angles
        self.figure, axes = plt.subplots(1, 2, figsize=(9, 4.9), layout="constrained")
        extent = (0, size_m, 0, size_m)
        self.images = [
            ax.imshow(np.ones((2, 2)), cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="nearest")
            for ax in axes
        ]
        self.beams = axes[0].add_collection(LineCollection([], colors="#0b6e99", linewidths=0.4, alpha=0.5))
        self.robots = [ax.plot([], [], "o", color="#0b6e99", markersize=7)[0] for ax in axes]
        for ax in axes:
            ax.set(xlim=extent[:2], ylim=extent[2:], xlabel="x [m]")
        axes[0].set(ylabel="y [m]", title="true map, beams of the lidar")
        self.title = axes[1].set_title("")

    def show(self, frame: Frame) -> None:
        """Draw a frame."""
        self.images[0].set_data(frame.truth)
        directions = frame.pose[2] + self.angles
        reach = np.where(np.isfinite(frame.ranges), frame.ranges, 100)[:, None]
        ends = frame.pose[:2] + reach * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        self.beams.set_segments([np.stack([frame.pose[:2], end]) for end in ends])
        for robot in self.robots:
            robot.set_data(frame.pose[:1], frame.pose[1:2])
        if frame.predicted is None:
            self.title.set_text(f"scan {frame.step + 1}: collecting the first window")
            return
        self.images[1].set_data(shade(frame.predicted.free, frame.predicted.unknown))
        obstacle, predicted = frame.truth == 0, frame.predicted.free < 0.5
        overlap = (obstacle & predicted).sum() / max((obstacle | predicted).sum(), 1)
        self.title.set_text(f"scan {frame.step + 1}: prediction in {frame.latency_ms:.0f} ms, IoU {overlap:.2f}")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--exp", default="4", choices=("1", "2", "3", "4"), help="experiment of the paper")
    parser.add_argument("--seed", type=int, default=0, help="seed of the world")
    parser.add_argument("--steps", type=int, default=200, help="steps of 0.1 s; the first map comes after 100")
    parser.add_argument("--weights", type=Path, help="directory of a network; by default the one of the experiment")
    parser.add_argument("--every", type=int, default=2, help="steps between two frames of the GIF")
    parser.add_argument("--save", type=Path, help="write a GIF instead of opening a window")
    return parser.parse_args()


def load(weights: Path, size_m: float) -> Predictor:
    """Load a network whose map is as large as the world."""
    try:
        predictor = load_predictor(weights)
    except ValueError as error:
        raise SystemExit(f"--weights: {error}") from error
    if predictor.grid.size_m != size_m:
        raise SystemExit(f"--weights: its map has {predictor.grid.size_m:g} m, the world of the paper {size_m:g} m")
    return predictor


def main() -> None:
    options = arguments()
    if options.save and (options.save.suffix != ".gif" or not options.save.parent.is_dir()):
        raise SystemExit(f"--save: expected a .gif in a directory that exists, got {options.save}")
    if options.every < 1:
        raise SystemExit(f"--every: expected at least 1, got {options.every}")
    spec = world_spec(read_world(ROOT / "conf" / "world" / "paper.yaml"), options.exp)
    predictor = load(options.weights or ROOT / "reproduce" / "results" / WEIGHTS[options.exp], spec.world.width)
    if options.steps <= predictor.steps:
        raise SystemExit(f"--steps: expected more than the {predictor.steps} of a window, got {options.steps}")
    if options.save:
        matplotlib.use("agg")
    elif matplotlib.get_backend().lower() == "agg":
        raise SystemExit("no display for a window: write a GIF with --save FILE.gif")
    world = sample_world(spec, SHOWN_SEED + options.seed)
    env = make(world)
    view = View(np.array(env.robot.lidar.angle_list), spec.world.width)
    frames = drive(env, outlines_of_world(world), predictor, options)
    if options.save:
        shown = (frame for frame in frames if (frame.step + 1) % options.every == 0)
        animation = FuncAnimation(view.figure, view.show, frames=shown, cache_frame_data=False)
        animation.save(options.save, writer=PillowWriter(fps=10))
        print(options.save)
        return
    for frame in frames:
        if not plt.fignum_exists(view.figure.number):
            return
        view.show(frame)
        plt.pause(0.001)
    plt.show()


if __name__ == "__main__":
    main()
