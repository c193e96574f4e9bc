"""Draw a fast test course where a robot with the network's maps reaches its goals and one with classical maps collides.

    python -m reproduce.replay

takes the first such course of the published episodes and drives it again; needs the outputs of `make navigation`.
"""

import dataclasses
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.animation import FuncAnimation, PillowWriter

from repro.cli.compose import composed
from repro.cli.jobs import Job
from repro.cli.main import read_arguments, read_calls
from repro.cli.settings import NETWORK
from repro.cli.tasks.navigate import mapper_of
from repro.maps.outlines import placed
from repro.navigation.courses import Course, sample_course
from repro.navigation.episodes import EVERY, Fleet
from repro.navigation.mappers import Seen
from repro.navigation.surfaces import settings_of
from repro.recordings.datasets import grid_of
from repro.reporting.navigation_tables import BEST_OF, title_of
from repro.reporting.plots import ACCENT, INK, STYLE
from reproduce.calls import reported

RESULTS = Path("reproduce/results/navigation")
ANALYSIS = RESULTS / "analysis"
CALL = f"""task=navigate world=navigation exp=mixed scale=laptop scale.pairs.train=8 outputs=outputs/navigation
    navigation.mapper=network prediction.weights={RESULTS}/expmixed-convgru""".split()
WORLD, SIZE_M, GOAL = "fast", 50.0, "#d62728"
FPS, LASTING = 5, 10  # frames of the end


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """A map on which a robot plans, (H, W), its x, y [m], ends of beams [m], (N, 2), and outlines of obstacles."""

    occupied: np.ndarray
    place: np.ndarray
    ends: np.ndarray
    outlines: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """The frames of one robot on a course, the name of its maps and how it ended."""

    frames: list[Frame]
    title: str
    end: str


def main() -> None:
    """Choose the course, drive it with both maps and draw it."""
    parsed = read_arguments(CALL)
    with composed(parsed) as jobs:
        job = Job(read_calls(parsed, jobs)[0])
    rows = pd.read_csv(ANALYSIS / "navigation.csv").query("experiment == 'all'").set_index("mapper")
    network, _ = mapper_of(job, grid_of(job.config), NETWORK)
    scores = pd.read_csv(ANALYSIS / "navigation_surfaces.csv").groupby("mapper")["score"].max()
    best = str(scores[scores.index.isin(BEST_OF)].idxmax())
    test = pd.read_csv(ANALYSIS / "navigation_episodes.csv").query("split == 'test' and experiment == @WORLD")
    ends = {
        name: test[(test["mapper"] == name) & (test["settings"] == rows.loc[name, "settings"])].set_index("seed")
        for name in (best, network)
    }
    outcomes = pd.DataFrame({name: own["outcome"] for name, own in ends.items()})
    seed = int(outcomes.index[(outcomes[best] == "collision") & (outcomes[network] == "goal")].min())
    course = sample_course(job.call.specs[WORLD], seed)[0]
    settings = {name: settings_of(str(rows.loc[name, "settings"])) for name in ends}
    drives = [drive(job, course, name, settings[name]) for name in (best, network)]
    draw(drives, course.goals, ANALYSIS / "navigation_replay.gif")
    print(f"{ANALYSIS}/navigation_replay.gif: {WORLD}, course {seed}, {[one.end for one in drives]}")


def drive(job: Job, course: Course, name: str, settings: dict[str, Any]) -> Drive:
    """Drive a course with a mapper, and keep what is drawn."""
    grid = grid_of(job.config)
    _, mapper = mapper_of(job, grid, name if name in BEST_OF else NETWORK)
    frames: list[Frame] = []

    def maps(seen: Seen, who: np.ndarray, **chosen: Any) -> np.ndarray:
        found = mapper.maps(seen, who, **chosen)
        scan = seen.window(who)[0]
        ranges, (x, y, heading) = np.minimum(scan.ranges[-1], seen.range_max_m), scan.poses[-1]
        bearings = heading + seen.angles
        ends = np.array([x, y]) + ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        outlines = placed(course.outlines, seen.states[: len(course.outlines), 0, seen.step])
        frames.append(Frame(found[0, 0], scan.poses[-1, :2], ends, outlines))
        return found

    watched = dataclasses.replace(mapper, maps=maps)
    (episode,) = Fleet(job.call.specs[WORLD], [course], watched, [settings], grid).drive()
    return Drive(frames, title_of(name), f"{episode.outcome} after {episode.time_s:.1f} s")


def draw(drives: list[Drive], goals: np.ndarray, path: Path) -> None:
    """Write the animation: the worlds above, the maps of the robots below."""
    with plt.rc_context({**STYLE, "savefig.dpi": 70}):
        figure, axes = plt.subplots(2, len(drives), figsize=(3 * len(drives), 6.4), layout="constrained", squeeze=False)

        def show(number: int) -> list[Any]:
            for (above, below), one in zip(axes.T, drives, strict=True):
                index = min(number, len(one.frames) - 1)
                frame, path = one.frames[index], np.array([before.place for before in one.frames[: index + 1]])
                for ax in (above, below):
                    ax.clear()
                    ax.set(xticks=(), yticks=(), xlim=(0, SIZE_M), ylim=(0, SIZE_M), aspect="equal")
                    ax.plot(*goals.T, "*", color=GOAL, markersize=9)
                    ax.plot(*path.T, color=ACCENT, linewidth=1)
                    ax.plot(*path[-1], "o", color=ACCENT, markersize=5)
                for outline in frame.outlines:
                    above.fill(*outline.T, color=INK, alpha=0.7, linewidth=0)
                above.fill(*np.vstack([path[-1], frame.ends]).T, color=ACCENT, alpha=0.15, linewidth=0)
                extent = (0, SIZE_M, 0, SIZE_M)
                below.imshow(frame.occupied, cmap="gray_r", vmin=0, vmax=1, interpolation="nearest", extent=extent)
                is_over = number >= len(one.frames) - 1
                above.set_title(f"{one.title}\n{one.end if is_over else f'{index * EVERY / 10:.1f} s'}")
            return []

        longest = max(len(one.frames) for one in drives)
        order = [*range(0, longest, 2), *[longest] * LASTING]
        FuncAnimation(figure, show, frames=order).save(path, writer=PillowWriter(fps=FPS))
        plt.close(figure)


if __name__ == "__main__":
    reported(main)
