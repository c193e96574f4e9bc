"""Replay of one course of task=navigate, driven by two kinds of map: an animation, and a page with a player."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.animation import FuncAnimation, PillowWriter

from repro.navigation.courses import TURN_STEPS
from repro.navigation.episodes import EVERY, Fleet
from repro.reporting.animation import draw_world
from repro.reporting.plots import ACCENT, STYLE
from repro.scans import Scans
from repro.simulation.simulator import Recording
from repro.system.files import write_text

REPLAY = "navigation_replay.html"  # beside the figures of the analysis
FPS = 5
SHOWN = 2  # every second map is a frame
GOAL = "#d62728"
ICONS = {
    **{"minus": "\u2212", "plus": "+", "fast-backward": "\u23ee", "fast-forward": "\u23ed", "pause": "\u23f8"},
    **{"step-backward": "\u23f4|", "step-forward": "|\u23f5", "play": "\u23f5", "play fa-flip-horizontal": "\u23f4"},
}
STAY = 2 * FPS  # frames for which the end stays


@dataclass(frozen=True)
class Drive:
    """One drive.

    Args:
        title: that of the arm.
        recording: what the robot saw and where the obstacles were, T steps.
        maps: the maps on which it planned, probability of an obstacle, (M, H, W).
        step_s: duration of a step [s].
        end: how it ended.
    """

    title: str
    recording: Recording
    maps: np.ndarray
    step_s: float
    end: str


def telling_course(rows: pd.DataFrame, other: pd.DataFrame) -> tuple[str, int] | None:
    """Return experiment and seed of the first course that ends at the goal in `rows` and in a collision in `other`.

    The last experiment, which has the fastest obstacles, comes first.
    """
    both = rows.merge(other, on=["experiment", "seed"], suffixes=("", "_other"))
    found = both[(both["outcome"] == "goal") & (both["outcome_other"] == "collision")]
    for experiment in reversed(list(both["experiment"].unique())):
        if len(own := found[found["experiment"] == experiment]):
            return experiment, int(own["seed"].min())
    return None


def watch(fleet: Fleet, title: str) -> Drive:
    """Drive the only course of a fleet, and return what happened after the first turn."""
    ranges: list[np.ndarray] = []
    poses: list[np.ndarray] = []
    maps = [fleet.occupied]  # before the first one
    for step in fleet.steps():
        has_scan = fleet.seen.step == step  # not where a collision ends the drive
        ranges.append(fleet.seen.ranges[0, (step - 1) % TURN_STEPS].copy() if has_scan else ranges[-1])
        poses.append(fleet.poses[0].copy())
        if fleet.occupied is not maps[-1]:
            maps.append(fleet.occupied)
    after = slice(TURN_STEPS, len(poses))
    scans = Scans(np.array(ranges)[after], fleet.angles, np.array(poses)[after])
    states = fleet.obstacles[: len(fleet.courses[0].outlines), 0, TURN_STEPS + 1 : len(poses) + 1]
    episode = fleet.episodes[0]
    end = f"{episode.outcome} after {episode.time_s:.1f} s" + f" ({episode.contact})" * bool(episode.contact)
    recording = Recording(scans, fleet.courses[0].outlines, states, seen=None)
    return Drive(title, recording, np.array([planned[0, 0] for planned in maps[1:]]), fleet.step_s, end)


def write_replay(drives: Sequence[Drive], goals: np.ndarray, path: Path, *, size_m: float, range_max_m: float) -> None:
    """Write the animation of drives on one course as GIF, and beside it a page with a player.

    Args:
        drives: a column each: the world above, the map on which the robot plans below.
        goals: x, y of the goals [m], (G, 2).
        path: the GIF; the page has the same name with .html.
        size_m: side of the map [m].
        range_max_m: drawn length of a beam without a hit [m].
    """
    frames = [*range(0, max(len(drive.maps) for drive in drives), SHOWN), *[-1] * STAY]
    with plt.rc_context({**STYLE, "savefig.dpi": 70, "animation.embed_limit": 50}):
        figure, axes = plt.subplots(2, len(drives), figsize=(3 * len(drives), 6.4), layout="constrained", squeeze=False)
        look = {"cmap": "gray_r", "vmin": 0, "vmax": 1, "interpolation": "nearest", "extent": (0, size_m, 0, size_m)}
        panels = [ax.imshow(drive.maps[0], **look) for ax, drive in zip(axes[1], drives, strict=True)]
        for ax in axes.flat:
            ax.set(xticks=(), yticks=(), xlim=(0, size_m), ylim=(0, size_m), aspect="equal")

        def show(number: int) -> list:
            for column, (drive, panel) in enumerate(zip(drives, panels, strict=True)):
                last = len(drive.recording.scans.ranges) - 1
                step = min(number * EVERY, last) if number >= 0 else last
                panel.set_data(drive.maps[min(step // EVERY, len(drive.maps) - 1)])
                draw_world(axes[0, column], drive.recording, step, range_max_m)
                for line in axes[1, column].lines:
                    line.remove()
                axes[1, column].plot(*drive.recording.scans.poses[: step + 1, :2].T, color=ACCENT, linewidth=1)
                for ax in axes[:, column]:
                    ax.plot(*goals.T, "*", color=GOAL, markersize=9)
                axes[0, column].set_title(
                    f"{drive.title}\n{drive.end if step == last else f'{step * drive.step_s:.1f} s'}"
                )
            return panels

        animation = FuncAnimation(figure, show, frames=frames)
        animation.save(path, writer=PillowWriter(fps=FPS))
        write_text(path.with_suffix(".html"), _offline(animation.to_jshtml(fps=FPS, default_mode="once")))
        plt.close(figure)


def _offline(page: str) -> str:
    """Replace the icons of Matplotlib's player, which are fetched from the network, by characters."""
    page = re.sub(r"<link[^>]*font-awesome[^>]*>", "", page)
    return re.sub(r'<i class="fa fa-([a-z -]+)"></i>', lambda icon: ICONS[icon[1]], page)
