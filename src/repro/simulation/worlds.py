"""Experiment and seed to an IR-SIM world: sampled, turned around for its twin, written as YAML.

A world is the plain dictionary that IR-SIM reads from YAML (`world`, `robot`, `obstacle`), nothing else.
Written out by `write_world` it loads with `irsim.make` and replays to the recorded scans, once
`repro.simulation.behaviors` is imported.

Paper: "Simulation Approach". What it leaves open: DEVIATIONS D1 to D6.
"""

import copy
import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from repro.simulation.motions import robot_path

World = dict[str, Any]

_PLACEMENTS = 200  # tries for one obstacle
_RESTARTS = 100  # tries for one world


def sample_world(spec: dict[str, Any], seed: int) -> World:
    """Samples the world of one seed, with the robot going counter-clockwise.

    Args:
        spec: `world` and `robot` as IR-SIM reads them, `experiment` (its name), `motion` (the robot's
            behaviour), `obstacles` (the population: `count`, `radius_m`, `aspect`, `disc_share` and, when
            they move, `behavior`) and `clear_radius_m` (the centre zone).
        seed: any non-negative integer; the same seed gives the same world.

    Raises:
        ValueError: the obstacles do not fit, or the robot would leave its zone.
    """
    check_spec(spec)
    rng = np.random.default_rng([experiment_number(spec["experiment"]), seed])
    world = copy.deepcopy(spec["world"])
    population = spec["obstacles"]
    for _ in range(_RESTARTS):
        shapes = _place_obstacles(rng, world, population, spec["clear_radius_m"])
        if shapes is not None:
            break
    else:
        raise ValueError(
            f"no room for {population['count']} obstacles of radius {population['radius_m']} m outside "
            f"{spec['clear_radius_m']} m of the centre: use fewer, smaller, or a smaller clear_radius_m"
        )
    obstacles = [_obstacle(rng, spec, x, y, shape) for x, y, shape in shapes]
    robot = {**copy.deepcopy(spec["robot"]), "behavior": {**spec["motion"], "direction": 1}}
    robot["state"] = _start(spec["motion"], world, direction=1)
    return {"world": world, "robot": robot, "obstacle": obstacles}


def experiment_number(experiment: str) -> int:
    """Computes the number that sets the worlds of an experiment apart from another's; of a name, its hash."""
    if experiment.isdigit():
        return int(experiment)
    return int.from_bytes(hashlib.sha256(experiment.encode()).digest()[:8], "little")


def check_spec(spec: dict[str, Any]) -> None:
    """Checks what no single value shows: a square map, and a robot that stays in its zone.

    Raises:
        ValueError: the map is not square, or the robot would leave its zone.
    """
    world = spec["world"]
    clear_m = spec["clear_radius_m"]
    if world["width"] != world["height"]:
        raise ValueError(
            f"the world must be square, got world.world.width={world['width']} and height={world['height']}"
        )
    behavior = {**spec["motion"], "direction": 1}
    path = robot_path(behavior, _start(spec["motion"], world, direction=1), world["step_time"])
    reach_m = np.linalg.norm(path[:, :2] - world["width"] / 2, axis=1).max() + spec["robot"]["shape"].get("radius", 0)
    if clear_m > 0 and reach_m > clear_m:
        raise ValueError(
            f"the robot reaches {reach_m:.2f} m from the centre, beyond its clear zone of clear_radius_m={clear_m}: "
            "make the zone larger or the motion smaller"
        )


def reverse_direction(world: World) -> World:
    """Makes the twin: the robot turns and drives in the opposite direction among the very same obstacles."""
    twin = copy.deepcopy(world)
    behavior = twin["robot"]["behavior"]
    behavior["direction"] = -behavior["direction"]
    twin["robot"]["state"] = _start(behavior, world["world"], behavior["direction"])
    return twin


def write_world(world: World, path: Path) -> None:
    """Writes one plain IR-SIM YAML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = "# Plain IR-SIM world: import repro.simulation.behaviors, irsim.make(this file), 100 times env.step().\n"
    path.write_text(header + yaml.safe_dump(world, sort_keys=False, default_flow_style=None))


def shape_radius(shape: dict[str, Any]) -> float:
    """Computes the radius of the circle around an IR-SIM shape's own origin that holds it [m]."""
    if shape["name"] == "circle":
        return float(shape["radius"])
    return math.hypot(shape["length"], shape["width"]) / 2


def _place_obstacles(rng, world: World, population: dict, clear_radius_m: float) -> list | None:
    """Draws shapes and places them apart, inside the map, outside the zone; None if one does not fit."""
    centre = np.array([world["width"], world["height"]]) / 2
    placed: list[tuple[float, float, dict]] = []
    for _ in range(rng.integers(population["count"][0], population["count"][1] + 1)):
        shape = _shape(rng, population)
        radius = shape_radius(shape)
        for _ in range(_PLACEMENTS):
            x, y = rng.uniform(radius, 2 * centre - radius)
            apart = all(math.hypot(x - u, y - v) >= radius + shape_radius(s) for u, v, s in placed)
            if apart and math.hypot(x - centre[0], y - centre[1]) >= clear_radius_m + radius:
                placed.append((float(x), float(y), shape))
                break
        else:
            return None
    return placed


def _shape(rng, population: dict) -> dict[str, Any]:
    """Draws a disc of the drawn radius or a rectangle of the same area."""
    radius = rng.uniform(*population["radius_m"])
    is_disc, aspect = rng.random() < population["disc_share"], rng.uniform(*population["aspect"])
    if is_disc:
        return {"name": "circle", "radius": float(radius)}
    width = math.sqrt(math.pi * radius**2 / aspect)
    return {"name": "rectangle", "length": float(aspect * width), "width": float(width)}


def _obstacle(rng, spec: dict, x: float, y: float, shape: dict) -> dict[str, Any]:
    """Makes one obstacle as IR-SIM reads it, with its own random stream when it moves."""
    heading, behavior = float(rng.uniform(-math.pi, math.pi)), spec["obstacles"].get("behavior")
    obstacle = {"shape": shape, "state": [x, y, heading]}
    if behavior is None:
        return {**obstacle, "kinematics": {"name": "static"}}
    speed = float(rng.uniform(*behavior["speed_m_s"]))
    motion = {
        **behavior,
        "seed": int(rng.integers(2**31)),
        "speed_m_s": speed,
        "centre_m": [spec["world"]["width"] / 2, spec["world"]["height"] / 2],
        "keep_out_m": float(spec["clear_radius_m"] + shape_radius(shape)),
    }
    limit = 1.01 * speed
    return {
        **obstacle,
        "kinematics": {"name": "omni"},
        "vel_min": [-limit, -limit],
        "vel_max": [limit, limit],
        "behavior": motion,
    }


def _start(motion: dict, world: World, direction: int) -> list[float]:
    """Start pose [x, y, heading]: the centre, or on the square's left side, `first_steps` before the corner."""
    centre_x, centre_y = world["width"] / 2, world["height"] / 2
    if motion["name"] == "rotate":
        return [centre_x, centre_y, 0.0]
    half = motion["side_m"] / 2
    ahead = motion["side_m"] * motion["first_steps"] / motion["drive_steps"]  # to the corner below (1) or above (-1)
    return [centre_x - half, centre_y - direction * (half - ahead), -direction * math.pi / 2]
