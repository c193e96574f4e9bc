"""A person in a corridor: the maps before and after he leaves the view of a robot that passes him."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

from repro.maps.grid import Grid
from repro.reporting.plots import STYLE, save
from repro.scans import Scans
from repro.simulation.raycasting import scan
from repro.simulation.shapes import geometry
from reproduce.movers.scenes import within

WIDTH_M, LENGTH_M = 2.4, 60.0
ROBOT_M_S, WALK_M_S, RADIUS_M = 0.8, 0.9, 0.25
BESIDE_M = 0.6  # between the ways of the robot and the person, both as far from the walls
STEP_S, STEPS = 0.1, 100
RANGE_MAX_M = 30.0
SHOWN_S = (-1.0, 0.0, 0.5, 1.0, 2.0, 4.0)  # after the last hit
NEAR_M = 1.5  # from the person, where a map may still hold him
ANGLES = np.linspace(-np.pi / 4, np.pi / 4, 91)


@dataclass(frozen=True)
class Walk:
    """A person who passes the robot or stands, S scans.

    Args:
        scans: ranges (S, N), angles (N,), poses (S, 3).
        places: x, y of the person at each scan [m], (S, 2).
        last: the last scan that hits him.
    """

    scans: Scans
    places: np.ndarray
    last: int

    def window(self, after_s: float, size_m: float) -> tuple[Scans, np.ndarray]:
        """Return the window that ends some time after the last hit, and the place of the person on its map [m]."""
        end = self.last + 1 + round(after_s / STEP_S)
        poses = self.scans.poses[end - STEPS : end].copy()
        origin = poses[-1, :2] - size_m / 2
        poses[:, :2] -= origin
        return Scans(self.scans.ranges[end - STEPS : end], ANGLES, poses), self.places[end - 1] - origin


def walk(speed_m_s: float) -> Walk:
    """Return the scans of a robot that drives along a corridor past a person with a speed against it [m/s]."""
    steps = np.arange(4 * STEPS)
    meet = 2 * STEPS  # the step at which they are beside one another
    poses = np.zeros((len(steps), 3))
    poses[:, 0], poses[:, 1] = ROBOT_M_S * STEP_S * (steps - meet), -BESIDE_M / 2
    person = np.zeros((len(steps), 3))
    person[:, 0], person[:, 1] = -speed_m_s * STEP_S * (steps - meet), BESIDE_M / 2
    disc = np.array(geometry({"name": "circle", "radius": RADIUS_M}).exterior.coords)[:-1]
    half = WIDTH_M / 2
    wall = np.full((len(disc), 2), [-LENGTH_M, 0.0])
    wall[: len(disc) // 2, 0] = LENGTH_M
    outlines = np.stack([disc, wall, wall])
    still = np.zeros((2, len(steps), 3))
    still[0, :, 1], still[1, :, 1] = -half, half
    states = np.concatenate([person[None], still])
    ranges, _ = scan(poses, ANGLES, outlines, states, RANGE_MAX_M)
    empty, _ = scan(poses, ANGLES, outlines[1:], states[1:], RANGE_MAX_M)
    return Walk(Scans(ranges, ANGLES, poses), person[:, :2], int(np.flatnonzero((ranges != empty).any(1))[-1]))


def rows(maps: Mapping[str, Any], grids: Mapping[str, Grid]) -> Iterator[dict[str, object]]:
    """Yield the largest probability of an obstacle on the person, and within 1.5 m, by the time since the last hit.

    Args:
        maps: functions from a window to the probability of an obstacle, (H, W), by their names.
        grids: their grids.
    """
    for motion, speed_m_s in (("walks", WALK_M_S), ("stands", 0.0)):
        found = walk(speed_m_s)
        for after_s in np.arange(SHOWN_S[0], SHOWN_S[-1] + 0.01, 0.5).round(1):
            for name, predict in maps.items():
                scans, place = found.window(after_s, grids[name].size_m)
                obstacle, grid = predict(scans), grids[name]
                near = within(grid, place, NEAR_M) & _inside(grid, scans.poses[-1, 1] + BESIDE_M / 2)
                on_him = obstacle[within(grid, place, RADIUS_M)].max()
                row = {"person": motion, "after_s": after_s, "map": name, "on_person": float(on_him)}
                yield row | {"within_1.5_m": float(obstacle[near].max())}


def _inside(grid: Grid, middle_m: float) -> np.ndarray:
    """Return the pixels of the corridor, without those beside its walls, (H, 1)."""
    y = grid.resolution_m * (np.arange(grid.size_px)[::-1] + 0.5)
    return (np.abs(y - middle_m) < WIDTH_M / 2 - 1.5 * grid.resolution_m)[:, None]


def figure(maps: Mapping[str, Any], grids: Mapping[str, Grid], stem: Path) -> None:
    """Draw the maps around the robot of a person who walks by, a row for each map, a column for each time.

    Maps without a network hold movers only, not the walls.
    """
    found = walk(WALK_M_S)
    with plt.rc_context(STYLE):
        shape = len(maps), len(SHOWN_S)
        drawn, axes = plt.subplots(*shape, figsize=(7.5, 0.3 + 0.3 * len(maps)), layout="constrained", squeeze=False)
        for line, (name, predict) in zip(axes, maps.items(), strict=True):
            grid = grids[name]
            for ax, after_s in zip(line, SHOWN_S, strict=True):
                scans, place = found.window(after_s, grid.size_m)
                extent = (0, grid.size_m, 0, grid.size_m)
                ax.imshow(1 - predict(scans), cmap="gray", vmin=0, vmax=1, extent=extent)
                ax.add_patch(
                    Circle((float(place[0]), float(place[1])), RADIUS_M, fill=False, color="#d1711a", linewidth=0.8)
                )
                x, y, _ = scans.poses[-1]
                ax.plot([x], [y], ">", color="#0b6e99", markersize=3)
                ax.set(xlim=(x - 8, x + 4), ylim=(y - 1.2, y + 1.8), xticks=[], yticks=[])
            line[0].set_ylabel(name, rotation=0, ha="right", va="center")
        for ax, after_s in zip(axes[0], SHOWN_S, strict=True):
            ax.set_title(f"{after_s:+g} s" if after_s else "last hit")
        save(drawn, stem, ("png",))
