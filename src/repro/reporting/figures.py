"""The paper's four figures: arrays and worlds in, `Figure` out; `write_figures` saves them as PNG and PDF."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from repro.evaluation.scoring import read_predictions
from repro.recordings.datasets import encoding_of, grid_of
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import true_maps
from repro.reporting.names import experiment_title
from repro.reporting.plots import ACCENT, STYLE, save, save_or_delete
from repro.runs.config import PROJECTION
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.scans import Scans
from repro.simulation.sampling import World, reverse_direction
from repro.simulation.simulator import make
from repro.worlds.robot_motions import drive_of


@dataclass(frozen=True)
class Example:
    """A test recording and its prediction.

    Args:
        experiment: the experiment.
        encoding: label of the encoding, the paper's projection or its ablation.
        projection: gray image, 0 black to 255 white, (H, W).
        prediction: probability of free, (H, W).
        truth: true map, 1 is free, (H, W).
        scans: the scans of the recording, ranges (T, N).
        oldest_gray: gray value of the oldest hit, 1 is white.
    """

    experiment: str
    encoding: str
    projection: np.ndarray
    prediction: np.ndarray
    truth: np.ndarray
    scans: Scans
    oldest_gray: float


def load_example(outputs: Outputs, key: RunKey) -> Example:
    """Read the first test recording with its input image, the prediction of a run and the true map.

    Args:
        outputs: an outputs directory with this network evaluated.
        key: key of the run.

    Raises:
        InputError: the run or its recordings do not exist or cannot be read.
    """
    run = outputs.run(key)
    config, shard = run.config(), next(open_recordings(outputs.recordings(key.experiment)).shards("test"))
    assert config.encoding, "a network has an encoding"
    grid = grid_of(config)
    return Example(
        key.experiment,
        key.encoding,
        encoding_of(config).encode(shard.scans[:1].batched(), grid)[0, 0],
        read_predictions(run)[0],
        true_maps(shard, grid)[0],
        shard.scans[0],
        config.encoding.parameters["oldest_gray"],
    )


def write_figures(directory: Path, worlds: dict[str, World], examples: list[Example]) -> list[Path]:
    """Write every figure that has data as PNG and PDF, and delete those without.

    Args:
        directory: directory of the figures, created if missing.
        worlds: one world by experiment.
        examples: one test recording of each experiment and ablation.

    Returns:
        the PNG files written.
    """
    decayed = [example for example in examples if example.encoding == PROJECTION]
    directory.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        drawn = {
            "data_collection": data_collection(worlds) if worlds else None,
            "method_overview": method_overview(decayed[-1]) if decayed else None,
            "data_representation": data_representation(decayed) if decayed else None,
            "results": results(examples) if examples else None,
        }
        written = [save_or_delete(figure, directory / name) for name, figure in drawn.items()]
    return [path for path in written if path]


def write_world_figure(world: World, experiment: str, path: Path) -> None:
    """Write IR-SIM's rendering of a world and its twin at the end of the recording as PNG, see `data_collection`."""
    steps = drive_of(world["robot"]["behavior"]).steps
    twins = {f"{experiment}, there": world, f"{experiment}, back": reverse_direction(world)}
    with plt.rc_context(STYLE):
        figure = data_collection(twins, steps)
        save(figure, path.with_suffix(""), ("png",))


def data_collection(worlds: dict[str, World], step: int = 70) -> Figure:
    """Plot IR-SIM's rendering of each setup after some steps: obstacles, robot, beams and the paths so far."""
    figure, axes = plt.subplots(1, len(worlds), figsize=(3 * len(worlds), 3.2), layout="constrained", squeeze=False)
    for ax, (experiment, world) in zip(axes[0], worlds.items(), strict=True):
        size = world["world"]["width"]
        ax.imshow(irsim_drawing(world, step), extent=(0, size, 0, size))
        ax.set(xticks=(0, size / 2, size), yticks=(0, size / 2, size), xlabel="x [m]")
        ax.set_title(experiment_title(experiment, "\n{}"))
    axes[0, 0].set_ylabel("y [m]")
    return figure


def irsim_drawing(world: World, step: int, size_px: int = 720) -> np.ndarray:
    """Return IR-SIM's rendering of a world after some steps, RGBA, uint8, (size_px, size_px, 4)."""
    plot = {"no_axis": True, "show_title": False, "figure_pixels": [size_px, size_px]}
    env = make({**world, "world": {**world["world"], "plot": plot}}, headless=False, display=False)
    for _ in range(step):
        env.step()
    env.render(0, show_trail=False)
    for item in env.objects:
        if not item.static:
            color = ACCENT if item.role == "robot" else "tab:orange"
            env.draw_trajectory(item.trajectory, "-", color=color, linewidth=2.5)
    figure = plt.gcf()
    figure.axes[0].set_position((0, 0, 1, 1))
    figure.canvas.draw()
    drawing = np.asarray(figure.canvas.buffer_rgba()).copy()  # type: ignore[attr-defined]
    env.end(0)
    plt.close(figure)
    return drawing


def data_representation(examples: list[Example]) -> Figure:
    """Plot the cumulative dynamic sensor projection of one recording per experiment."""
    figure, axes = plt.subplots(1, len(examples), figsize=(3 * len(examples), 3.3), layout="constrained")
    for ax, example in zip(np.atleast_1d(axes), examples, strict=True):
        shown = _image(ax, example.projection, _title(example))
    bar = figure.colorbar(shown, ax=axes, fraction=0.012, pad=0.01, ticks=[0, 255 * examples[0].oldest_gray, 255])
    bar.ax.set_yticklabels(["last step", "first step", "no hit"])
    return figure


def results(examples: list[Example]) -> Figure:
    """Plot input, prediction and ground truth of U-Net, one column per setup."""
    figure, axes = plt.subplots(3, len(examples), figsize=(1.9 * len(examples), 6), layout="constrained", squeeze=False)
    for column, example in zip(axes.T, examples, strict=True):
        _image(column[0], example.projection, _title(example))
        _image(column[1], 255 * example.prediction)
        _image(column[2], 255 * example.truth)
    for ax, name in zip(axes[:, 0], ("Sensor input", "Prediction", "Ground truth"), strict=True):
        ax.set_ylabel(name)
    return figure


def method_overview(example: Example) -> Figure:
    """Plot the pipeline for one recording: scans and poses, projection, prediction, ground truth."""
    figure, axes = plt.subplots(1, 5, figsize=(12, 2.7), layout="constrained")
    _show_scans(axes[0], example)
    _show_poses(axes[1], example)
    _image(axes[2], example.projection, "Cumulative dynamic\nsensor projection")
    _image(axes[3], 255 * example.prediction, "Map predicted by an image-\nto-image network (U-Net)")
    _image(axes[4], 255 * example.truth, "Ground truth: loss,\nmetrics")
    for ax, form in zip(axes[2:], ("-|>", "-|>", "<|-|>"), strict=True):
        arrow = {"arrowstyle": form, "color": ACCENT}
        ax.annotate("", (-0.02, 0.5), (-0.2, 0.5), "axes fraction", arrowprops=arrow)
    return figure


def _show_scans(ax: Axes, example: Example) -> None:
    """Plot all scans of a recording as one image, one row per step; misses are white."""
    ranges = example.scans.ranges
    ax.imshow(np.where(np.isfinite(ranges), ranges, np.nan), aspect="auto", cmap="viridis_r")
    ax.set(title="Lidar ranges", ylabel="step", xlabel="beam")


def _show_poses(ax: Axes, example: Example) -> None:
    """Plot every fourth pose of the robot as an arrow, the newest darkest."""
    x, y, heading = example.scans.poses[::4].T
    ax.quiver(x, y, np.cos(heading), np.sin(heading), np.arange(len(x)), cmap="Greys", clim=(-10, 25), angles="xy")
    ax.set(title="Robot poses", aspect="equal", xticks=(), yticks=())
    ax.margins(0.3)


def _title(example: Example) -> str:
    if example.encoding == PROJECTION:
        return experiment_title(example.experiment, "\n{}")
    return f"Experiment {example.experiment}\nNo time decay"


def _image(ax: Axes, image: np.ndarray, title: str = "") -> Any:
    """Plot a gray image, 0 black to 255 white, without ticks."""
    shown = ax.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    ax.set(xticks=(), yticks=(), title=title)
    return shown
