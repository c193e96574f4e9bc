"""The animation of a recording with its input image, prediction and true map."""

import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Circle

from repro.maps.ground_truth import rasterize
from repro.maps.projection import Projection
from repro.networks.predictor import Predictor
from repro.outlines import placed
from repro.reporting.plots import ACCENT, INK, STYLE
from repro.scans import Scans
from repro.simulation.simulator import Recording

FPS = 10
MOST_FRAMES = 200
BATCH = 16  # windows that are in memory at the same time
PANEL_TITLES = ("World, robot, {:.0f}° lidar", "Scans, dark is recent", "Prediction", "Ground truth")


@dataclass(frozen=True)
class Frames:
    """The images of an animation at F steps.

    Args:
        steps: the steps, counted from 1, (F,).
        images: the scans up to the step as the network receives them, or as the paper's image if it receives a series,
            uint8, (F, H, W).
        predictions: probability of free, (F, H, W).
        maps: true maps, 1 is free, (F, H, W).
    """

    steps: np.ndarray
    images: np.ndarray
    predictions: np.ndarray
    maps: np.ndarray


def make_frames(recording: Recording, predictor: Predictor, every: int | None = None) -> Frames:
    """Predict the map every few steps from the scans so far; the steps before have no valid reading.

    Args:
        recording: a recording of T steps.
        predictor: the network.
        every: number of steps from one frame to the next; None for 2, or more if these are over `MOST_FRAMES` frames.
    """
    total, grid = len(recording.scans.ranges), predictor.grid
    every = every or max(2, math.ceil(total / MOST_FRAMES))
    steps = np.arange(total, 0, -every)[::-1]  # the last one is a frame
    images, predictions = [], []
    for part in np.array_split(steps, math.ceil(len(steps) / BATCH)):
        windows = Scans.stack([_so_far(recording.scans, int(step)) for step in part]).tensors()
        encoded = predictor.encoding.encode(windows, grid)
        predictions.append(predictor.predict_images(encoded)[:, 0])
        images.append((encoded if len(encoded[0]) == 1 else Projection().encode(windows, grid))[:, 0])
    states = torch.as_tensor(recording.states[:, steps - 1]).float().flatten(0, 1)  # (O F, 3), obstacle by obstacle
    outlines = torch.as_tensor(recording.outlines).float().repeat_interleave(len(steps), dim=0)
    owner = torch.arange(len(steps)).repeat(len(recording.states))
    maps = rasterize(outlines, states, owner, len(steps), grid)
    return Frames(steps, torch.cat(images).numpy(), torch.cat(predictions).numpy(), maps.numpy())


def write_animation(recording: Recording, frames: Frames, path: Path, *, size_m: float, range_max_m: float) -> None:
    """Write the animation as GIF.

    Args:
        recording: the recording.
        frames: see `make_frames`.
        path: the file.
        size_m: side of the map [m].
        range_max_m: drawn length of a beam without a hit [m].
    """
    with plt.rc_context({**STYLE, "savefig.dpi": 90}):
        figure, axes = plt.subplots(1, 4, figsize=(10, 2.9), layout="constrained")
        for ax, title in zip(axes, PANEL_TITLES, strict=True):
            ax.set(xticks=(), yticks=(), title=title.format(np.degrees(np.ptp(recording.scans.angles))))
        panels = [
            ax.imshow(np.zeros_like(frames.images[0]), cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            for ax in axes[1:]
        ]
        axes[0].set(xlim=(0, size_m), ylim=(0, size_m), aspect="equal")
        footer = figure.supxlabel("step 0", fontsize=9)

        def show(number: int) -> list[Artist]:
            shown = (frames.images[number], 255 * frames.predictions[number], 255 * frames.maps[number])
            for panel, image in zip(panels, shown, strict=True):
                panel.set_data(image)
            draw_world(axes[0], recording, int(frames.steps[number]) - 1, range_max_m)
            footer.set_text(f"step {frames.steps[number]} of {len(recording.scans.ranges)}")
            return [*panels, footer]

        order = [*range(len(frames.steps)), *[len(frames.steps) - 1] * FPS]  # the last frame stays for a second
        FuncAnimation(figure, show, frames=order).save(path, writer=PillowWriter(fps=FPS))
        plt.close(figure)


def _so_far(scans: Scans, step: int) -> Scans:
    """Return the scans up to a step as a window of full length, with invalid readings before the first scan."""
    total = len(scans.ranges)
    ranges = np.full(scans.ranges.shape, np.nan)
    poses = np.repeat(scans.poses[:1], total, axis=0)
    ranges[total - step :], poses[total - step :] = scans.ranges[:step], scans.poses[:step]
    return Scans(ranges, scans.angles, poses)


def draw_world(ax: Axes, recording: Recording, step: int, range_max_m: float) -> None:
    """Draw the obstacles, the beams, the robot and its path at a step."""
    for drawn in (*ax.collections, *ax.patches, *ax.lines):
        drawn.remove()
    outlines = placed(recording.outlines, recording.states[:, step])
    ax.add_collection(PolyCollection(list(outlines), facecolor="#888888", edgecolor=INK, linewidth=0.5))
    pose, scan = recording.scans.poses[step], recording.scans.ranges[step]
    bearing, reach = pose[2] + recording.scans.angles, np.minimum(scan, range_max_m)
    ends = pose[:2] + reach[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    beams = [np.stack([pose[:2], end]) for end in ends]
    ax.add_collection(LineCollection(beams, colors=ACCENT, linewidths=0.4, alpha=0.5))
    ax.plot(*recording.scans.poses[: step + 1, :2].T, color=ACCENT, linewidth=1)
    ax.add_patch(Circle(tuple(pose[:2]), ax.get_xlim()[1] / 50, color=ACCENT, zorder=3))
