"""The worlds of the page: `python -m repro.demo.worlds` samples them with IR-SIM and writes assets/worlds.json.

The page itself needs no simulator, so that it can be made without the study.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from repro.recordings.format import SHOWN_SEED
from repro.simulation.sampling import World, sample_world
from repro.simulation.simulator import drive_robot, move_obstacles, outlines_of_world
from repro.system.files import write_text
from repro.system.project import conf_directory
from repro.worlds.spec import WorldSpec, read_world, world_spec

FILE = Path(__file__).with_name("assets") / "worlds.json"
WORLDS, WINDOWS = 3, 6  # of each experiment, and the length of a world
STRAIGHT_M = 1e-6  # change of the motion per step below which an obstacle goes on [m]


def describe() -> dict[str, Any]:
    """Return lidar, window and worlds of the paper's experiments, as assets/main.js takes them."""
    world = read_world(conf_directory() / "world" / "paper.yaml")
    specs = {name: world_spec(world, name) for name in world["experiments"]}
    spec = specs["1"]
    return {
        "lidar": spec.lidar.irsim(),
        **{"sizeM": spec.world.width, "stepMs": 1000 * spec.world.step_time, "steps": spec.steps},
        "longest": WINDOWS * spec.steps - 1,
        "worlds": {_title(name, own): _worlds(own) for name, own in specs.items()},
    }


def describe_world(world: World, steps: int) -> dict[str, Any]:
    """Return the robot and the obstacles of a world over some steps, as assets/world.js takes them."""
    states = move_obstacles(world, steps)
    return {
        "poses": drive_robot(world).round(6).tolist(),
        "outlines": [outline.ravel().tolist() for outline in outlines_of_world(world).round(4)],
        "headings": states[:, 0, 2].round(6).tolist(),
        "paths": [_turns(path) for path in states[:, :, :2]],
    }


def _turns(path: np.ndarray) -> list[list[float]]:
    """Return step, x, y [m] where a path (T, 2) of straight parts at constant speed begins, changes and ends."""
    changes = np.flatnonzero((np.abs(np.diff(path, 2, axis=0)) > STRAIGHT_M).any(1)) + 1
    steps = [0] if (path == path[0]).all() else [0, *changes.tolist(), len(path) - 1]
    return [[step, *path[step].round(4).tolist()] for step in steps]


def _worlds(spec: WorldSpec) -> list[dict[str, Any]]:
    return [describe_world(sample_world(spec, SHOWN_SEED + seed), WINDOWS * spec.steps) for seed in range(WORLDS)]


def _title(name: str, spec: WorldSpec) -> str:
    moves = "rotates" if spec.motion.name == "rotate" else "drives"
    return f"{name}: {'moving' if spec.behaviors else 'static'}, robot {moves}"


if __name__ == "__main__":
    write_text(FILE, json.dumps(describe(), separators=(",", ":")))
