"""Simulation of one recording: scans, obstacle outlines and states.

IR-SIM is the reference (`replay`). `simulate` computes the same recording from the same world, behaviors, kinematics,
outlines, noise and ray-segment equations, all scans at once and without IR-SIM's bookkeeping (collision, goal and
status checks, geometry trees, YAML). The tests require that the two agree to 1e-9 m, and `simulation.recorder` refuses
a difference of more than 1e-6 m in a sample of the worlds of every recorded experiment.

One case is left to IR-SIM: beams through a corner of a fixed obstacle, where rounding decides between a hit and a miss.
"""

import json
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from repro.maps.outlines import padded
from repro.scans import Scans
from repro.simulation import behaviors  # noqa: F401  before IR-SIM: registers our behaviors and silences its import
from repro.simulation.raycasting import grazes, scan
from repro.simulation.sampling import World
from repro.simulation.shapes import Shape
from repro.system.errors import InputError
from repro.worlds.obstacle_motions import obstacle_states
from repro.worlds.robot_motions import drive_of

# isort: split
import irsim
from irsim.lib.algorithm.kinematics import differential_kinematics
from irsim.lib.handler.geometry_handler import GeometryFactory


@dataclass(frozen=True)
class Recording:
    """A recording: T steps with N beams in a world of O obstacles with at most V vertices.

    Args:
        scans: ranges (T, N), angles (N,) and robot poses (T, 3) after each step.
        outlines: obstacle outlines in their own frame [m], (O, V, 2); shorter ones repeat their last vertex. A line
            string goes there and back, so that its outline encloses no area.
        states: obstacle pose after each step: x, y [m], heading [rad], (O, T, 3).
        seen: whether any beam hit each obstacle, (O,), before noise, see `format.ShardContent`.
    """

    scans: Scans
    outlines: np.ndarray
    states: np.ndarray
    seen: np.ndarray


def simulate(world: World) -> Recording:
    """Simulate one world.

    Raises:
        InputError: the robot's commands exceed its `vel_max` (IR-SIM would clip them silently), or an
            obstacle reaches the robot.
    """
    steps = drive_of(world["robot"]["behavior"]).steps
    poses, states, outlines = drive_robot(world), move_obstacles(world, steps), outlines_of_world(world)
    lidar, fixed = world["robot"]["sensors"][0], world.get("custom", {}).get("fixed", 0)
    angles, has_noise = beam_angles(lidar), lidar.get("noise", False)
    if has_noise:  # IR-SIM's first scan, before the first step, draws noise as well
        poses = np.concatenate([[world["robot"]["state"]], poses])
        states = np.concatenate([first_states(world)[:, None], states], axis=1)
    ranges, seen = scan(poses, angles, outlines, states, lidar["range_max"])
    grazing = fixed > 0 and grazes(poses, angles, outlines[:fixed], states[:fixed])
    if has_noise:
        ranges = _with_noise(ranges, lidar, world["custom"]["seed"])[1:]
        poses, states = poses[1:], states[:, 1:]
    scans = replay(world)[0] if grazing else Scans(ranges, angles, poses)
    return Recording(scans, outlines, states, seen)


def _with_noise(ranges: np.ndarray, lidar: dict[str, Any], seed: int) -> np.ndarray:
    """Add IR-SIM's noise to ranges (T, N): normal, scan by scan for the hits; a result out of range is a miss."""
    hit = np.isfinite(ranges)
    noisy = ranges.copy()
    noisy[hit] += np.random.default_rng(seed).normal(0, lidar["std"], int(hit.sum()))
    return np.where((noisy >= lidar.get("range_min", 0)) & (noisy <= lidar["range_max"]), noisy, np.inf)


def replay(world: World) -> tuple[Scans, np.ndarray]:
    """Simulate one world in plain IR-SIM: create the environment, step it to its end and copy each scan.

    Returns:
        the scans, and the obstacle pose after each step: x, y [m], heading [rad], (O, T, 3).

    Raises:
        InputError: a behavior is not active.
    """
    env = make(world)
    lidar = env.robot.lidar
    ranges, poses, states = [], [], []
    for _ in range(drive_of(world["robot"]["behavior"]).steps):
        env.step()
        ranges.append(np.where(lidar.valid, lidar.range_data, np.inf))
        poses.append(env.robot.state[:3, 0].copy())
        states.append([obstacle.state[:3, 0].copy() for obstacle in env.obstacle_list])
    scans = Scans(np.array(ranges), np.asarray(lidar.angle_list), np.array(poses))
    return scans, np.array(states).swapaxes(0, 1)


def check_replay(world: World, recording: Recording) -> float:
    """Replay a world in plain IR-SIM, compare, and return the largest difference of a range [m].

    Raises:
        InputError: the two disagree on which beams hit, or a range, a state of an obstacle, a pose of the robot or an
            angle of a beam differs by more than 1e-6.
    """
    reference, states = replay(world)
    expected, simulated = reference.ranges, recording.scans.ranges
    hit = np.isfinite(expected)
    if not np.array_equal(hit, np.isfinite(simulated)):
        raise InputError(f"plain IR-SIM and the recorder disagree on which beams hit in the world {world}")
    range_error = float(np.abs(expected[hit] - simulated[hit]).max(initial=0))
    errors = {
        "ranges [m]": range_error,
        "obstacle states": float(np.abs(states - recording.states).max()),
        "poses": float(np.abs(reference.poses - recording.scans.poses).max()),
        "angles [rad]": float(np.abs(reference.angles - recording.scans.angles).max()),
    }
    if max(errors.values()) > 1e-6:
        differences = ", ".join(f"{error} in {name}" for name, error in errors.items())
        raise InputError(f"plain IR-SIM differs by {differences}, in the world {world}")
    return range_error


def make(world: World, **options: Any) -> Any:
    """Create the IR-SIM environment of a world, with options of `irsim.make`; all its behaviors are active.

    Raises:
        InputError: a behavior is not active.
    """
    seed = world.get("custom", {}).get("seed")  # of the noise
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(yaml.safe_dump(world, sort_keys=False), encoding="utf-8")
        env = irsim.make(str(path), **{"headless": True, "log_level": "ERROR", "seed": seed, **options})
    for item in env.objects:
        if item.obj_behavior.behavior_dict and item.obj_behavior._invoke_func is None:
            raise InputError(
                f"the behavior {item.obj_behavior.behavior_dict} is not active: it lacks parameters, or "
                "simulation/behaviors.py does not register its name"
            )
    return env


def beam_angles(lidar: dict[str, Any]) -> np.ndarray:
    """Compute the beam angles in the robot's frame [rad], (N,), in IR-SIM's even spacing."""
    return np.linspace(-lidar["angle_range"] / 2, lidar["angle_range"] / 2, lidar["number"])


def drive_robot(world: World) -> np.ndarray:
    """Compute the pose of the robot after each step with IR-SIM's differential kinematics, (T, 3)."""
    robot = world["robot"]
    behavior = json.dumps(robot["behavior"], sort_keys=True)  # a key of the cache
    return _drive(behavior, tuple(robot["state"]), tuple(robot["vel_max"]), world["world"]["step_time"]).copy()


@lru_cache(maxsize=16)
def _drive(behavior: str, start: tuple, vel_max: tuple, step_time: float) -> np.ndarray:
    commands = drive_of(json.loads(behavior)).commands(step_time)
    if (np.abs(commands).max(axis=0) > vel_max).any():
        raise InputError(
            f"the robot needs up to {np.abs(commands).max(axis=0)} m/s, rad/s but vel_max is {list(vel_max)}"
        )
    state, poses = np.array(start, dtype=float)[:, None], []
    for command in commands:
        state = differential_kinematics(state, command[:, None], step_time)
        poses.append(state[:, 0])
    return np.array(poses)


def move_obstacles(world: World, steps: int) -> np.ndarray:
    """Compute the states of the obstacles after each of T steps, (O, T, 3); their headings are constant."""
    step_time = world["world"]["step_time"]
    return np.stack([obstacle_states(obstacle, steps, step_time) for obstacle in world["obstacle"]])


def first_states(world: World) -> np.ndarray:
    """Return the states of the obstacles before the first step, (O, 3)."""
    return np.array([obstacle["state"] for obstacle in world["obstacle"]], dtype=float)


def outlines_of_world(world: World) -> np.ndarray:
    """Create the outlines of the obstacles of a world with IR-SIM's geometry [m], (O, V, 2)."""
    own = [_outline_of(obstacle["shape"])[None] for obstacle in world["obstacle"]]
    longest = max(outline.shape[1] for outline in own)
    return np.concatenate([padded(outline, longest) for outline in own])


def _outline_of(shape: Shape) -> np.ndarray:
    """Return the outline of a shape as IR-SIM creates it, (V, 2); a line string goes there and back."""
    if shape["name"] == "linestring":
        line = np.array(shape["vertices"], float)
        return np.concatenate([line, line[-2:0:-1]])
    return GeometryFactory.create_geometry(**shape).original_vertices.T
