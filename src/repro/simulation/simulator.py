"""One simulated recording: scans, obstacle outlines and states.

IR-SIM defines what a recording is (`replay`). `simulate` computes the same from the same world, behaviours,
kinematics, outlines and ray-segment equations without IR-SIM's bookkeeping (collision, goal and status
checks, geometry trees, YAML): all 100 scans at once. The two agree to 1e-9 m; `shards` replays a sample of
every recorded experiment to prove it, and the tests and the bench do too.
"""

import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from repro.scans import Scans
from repro.simulation import behaviors  # noqa: F401  before IR-SIM: it registers ours and keeps the import quiet
from repro.simulation.motions import Drift, robot_commands
from repro.simulation.raycasting import scan
from repro.simulation.worlds import World, write_world

# isort: split
import irsim
from irsim.lib.algorithm.kinematics import differential_kinematics
from irsim.lib.handler.geometry_handler import GeometryFactory


@dataclass(frozen=True)
class Recording:
    """T steps of a world with N beams among O obstacles of at most V vertices.

    Args:
        scans: ranges (T, N), angles (N,) and robot poses (T, 3) after each step.
        outlines: convex obstacle outlines in their own frame [m], (O, V, 2); shorter ones repeat their last vertex.
        states: obstacle pose after each step: x, y [m], heading [rad], (O, T, 3).
        seen: whether any beam hit the obstacle, (O,); None where that is unknown.
    """

    scans: Scans
    outlines: np.ndarray
    states: np.ndarray
    seen: np.ndarray | None


def simulate(world: World) -> Recording:
    """Simulates one world.

    Raises:
        ValueError: the robot's commands exceed its `vel_max` (IR-SIM would clip them silently), or an
            obstacle reaches the robot.
    """
    poses = drive_robot(world)
    states = move_obstacles(world)
    outlines = _outlines(world)
    lidar = world["robot"]["sensors"][0]
    angles = beam_angles(lidar)
    ranges, seen = scan(poses, angles, outlines, states, lidar["range_max"])
    return Recording(Scans(ranges, angles, poses), outlines, states, seen)


def replay(path: Path, *, env: Any = None) -> Recording:
    """Simulates one world YAML with plain IR-SIM: make, 100 times step, copy the scan.

    Args:
        path: a world written by `worlds.write_world`.
        env: an IR-SIM environment already made from `path`, to be stepped to its end.

    Raises:
        ValueError: IR-SIM did not load the file, or a behaviour is not active.
    """
    env = env or make(path)
    robot = env.robot
    obstacles = env.obstacle_list
    lidar = robot.lidar
    commands = robot_commands(robot.obj_behavior.behavior_dict, env.step_time)
    ranges, poses, states = [], [], []
    for _ in range(len(commands)):
        env.step()
        ranges.append(np.where(lidar.valid, lidar.range_data, np.inf))
        poses.append(robot.state[:3, 0].copy())
        states.append([obstacle.state[:3, 0].copy() for obstacle in obstacles])
    outlines = _pad([obstacle.original_vertices.T for obstacle in obstacles])
    scans = Scans(np.array(ranges), np.asarray(lidar.angle_list), np.array(poses))
    return Recording(scans, outlines, np.array(states).swapaxes(0, 1), seen=None)  # IR-SIM does not tell whom it hit


def check_replay(world: World, recording: Recording) -> float:
    """Replays a world by plain IR-SIM and compares; returns the largest difference of a range [m].

    Raises:
        ValueError: the two differ by more than a micrometre.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        write_world(world, path)
        truth = replay(path)
    expected, found = truth.scans.ranges, recording.scans.ranges
    hit = np.isfinite(expected)
    if not np.array_equal(hit, np.isfinite(found)):
        raise ValueError(f"plain IR-SIM hits and misses elsewhere in the world {world}")
    worst = float(np.abs(expected[hit] - found[hit]).max(initial=0))
    apart = float(np.abs(truth.states - recording.states).max())
    if max(worst, apart) > 1e-6:
        raise ValueError(
            f"plain IR-SIM differs by {worst} m in ranges, {apart} in obstacle states, in the world {world}"
        )
    return worst


def make(path: Path, **options: Any) -> Any:
    """Makes an IR-SIM environment and checks that it is the one the file describes.

    Raises:
        ValueError: the file is missing (IR-SIM would give an empty world), or a behaviour is not active.
    """
    if not Path(path).is_file():
        raise ValueError(f"no world YAML at {path}")
    env = irsim.make(str(path), **{"headless": True, "log_level": "ERROR", **options})
    for item in env.objects:
        if item.obj_behavior.behavior_dict and item.obj_behavior._invoke_func is None:
            raise ValueError(f"behaviour {item.obj_behavior.behavior_dict} is not active in {path}")
    return env


def beam_angles(lidar: dict[str, Any]) -> np.ndarray:
    """Computes the beam angles in the robot's frame [rad], (N,), as IR-SIM spreads them."""
    return np.linspace(-lidar["angle_range"] / 2, lidar["angle_range"] / 2, lidar["number"])


def drive_robot(world: World) -> np.ndarray:
    """Computes the poses of the robot after each step by IR-SIM's differential kinematics, (T, 3)."""
    robot = world["robot"]
    behavior = tuple(sorted(robot["behavior"].items()))
    return _drive(behavior, tuple(robot["state"]), tuple(robot["vel_max"]), world["world"]["step_time"])


@lru_cache(maxsize=16)
def _drive(behavior: tuple, start: tuple, vel_max: tuple, step_time: float) -> np.ndarray:
    commands = robot_commands(dict(behavior), step_time)
    if (np.abs(commands).max(axis=0) > vel_max).any():
        raise ValueError(
            f"the robot needs up to {np.abs(commands).max(axis=0)} m/s, rad/s but vel_max is {list(vel_max)}"
        )
    state, poses = np.array(start, dtype=float)[:, None], []
    for command in commands:
        state = differential_kinematics(state, command[:, None], step_time)
        poses.append(state[:, 0])
    return np.array(poses)


def move_obstacles(world: World) -> np.ndarray:
    """Computes the states of the obstacles after each step, (O, T, 3); the headings never change."""
    step_time = world["world"]["step_time"]
    steps = len(robot_commands(world["robot"]["behavior"], step_time))
    states = np.empty((len(world["obstacle"]), steps, 3))
    for state, obstacle in zip(states, world["obstacle"], strict=True):
        state[:] = obstacle["state"]
        if "behavior" not in obstacle:
            continue
        motion = Drift(**{key: value for key, value in obstacle["behavior"].items() if key != "name"})
        x, y, _ = obstacle["state"]
        for step in range(steps):
            vx, vy = motion.velocity(x, y, step_time)
            x, y = x + vx * step_time, y + vy * step_time
            state[step, :2] = x, y
    return states


def _outlines(world: World) -> np.ndarray:
    """Makes the outlines as IR-SIM builds them, (O, V, 2)."""
    shapes = [obstacle["shape"] for obstacle in world["obstacle"]]
    return _pad([GeometryFactory.create_geometry(**shape).original_vertices.T for shape in shapes])


def _pad(outlines: list[np.ndarray]) -> np.ndarray:
    """Stacks outlines; shorter ones repeat their last vertex, which adds edges of no length."""
    longest = max(len(outline) for outline in outlines)
    return np.stack([np.pad(o, ((0, longest - len(o)), (0, 0)), mode="edge") for o in outlines])
