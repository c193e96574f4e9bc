"""Worlds: sampling from an experiment and a seed, reversal for the twin, and export as IR-SIM YAML.

A world is the plain dictionary that IR-SIM reads from YAML (`world`, `robot`, `obstacle`). After
`repro.simulation.behaviors` is imported, `irsim.make` loads the file that `write_world` writes and reproduces the
recorded scans.

Paper: "Simulation Approach". Unstated details: DEVIATIONS D1 to D6.
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

_PLACEMENTS = 200  # attempts to place one obstacle
_RESTARTS = 100  # attempts to sample one world


def sample_world(spec: dict[str, Any], seed: int) -> World:
    """Sample the world of one seed, with the robot moving counter-clockwise.

    Args:
        spec: `world` and `robot` as IR-SIM reads them, `experiment` (its name), `motion` (the robot's
            behavior), `obstacles` (the population: `count`, `radius_m`, `aspect`, `disc_share` and, for moving
            obstacles, `behavior`) and `clear_radius_m` (radius of the center zone).
        seed: any non-negative integer; the same seed gives the same world.

    Raises:
        ValueError: the obstacles do not fit, or the robot would leave its zone.
    """
    check_spec(spec)
    _check_room(spec)
    rng = np.random.default_rng([experiment_number(spec["experiment"]), seed])
    world = copy.deepcopy(spec["world"])
    population = spec["obstacles"]
    for _ in range(_RESTARTS):
        shapes = _place_obstacles(rng, world, population, spec["clear_radius_m"])
        if shapes is not None:
            break
    else:
        raise ValueError(_no_room(spec))
    obstacles = [_obstacle(rng, spec, x, y, shape) for x, y, shape in shapes]
    robot = {**copy.deepcopy(spec["robot"]), "behavior": {**spec["motion"], "direction": 1}}
    robot["state"] = _start(spec["motion"], world, direction=1)
    return {"world": world, "robot": robot, "obstacle": obstacles}


def experiment_number(experiment: str) -> int:
    """Return the number that enters the random seed of an experiment's worlds; for a non-numeric name, its hash."""
    if experiment.isdigit():
        return int(experiment)
    return int.from_bytes(hashlib.sha256(experiment.encode()).digest()[:8], "little")


def check_spec(spec: dict[str, Any]) -> None:
    """Check the combination of values: the map is square, and the robot stays in its zone.

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
            f"the robot reaches {reach_m:.2f} m from the center, beyond its clear zone of clear_radius_m={clear_m}: "
            "make the zone larger or the motion smaller"
        )


def _check_room(spec: dict[str, Any]) -> None:
    """Check that the largest obstacles fit on the map, and that all of the smallest fit by their area.

    Raises:
        ValueError: they do not.
    """
    population, width, clear_m = spec["obstacles"], spec["world"]["width"], spec["clear_radius_m"]
    stretch = max(math.sqrt(math.pi * (ratio + 1 / ratio)) / 2 for ratio in population["aspect"])  # of a rectangle
    largest = population["radius_m"][1] * (stretch if population["disc_share"] < 1 else 1)
    area = population["count"][0] * math.pi * population["radius_m"][0] ** 2
    if 2 * largest > width or area > width**2 - math.pi * min(clear_m, width / 2) ** 2:
        raise ValueError(_no_room(spec))


def _no_room(spec: dict[str, Any]) -> str:
    population = spec["obstacles"]
    return (
        f"no room for {population['count']} obstacles of radius {population['radius_m']} m and aspect "
        f"{population['aspect']} outside {spec['clear_radius_m']} m of the center: use fewer or smaller obstacles, or "
        "a smaller clear_radius_m"
    )


def reverse_direction(world: World) -> World:
    """Create the twin: the robot moves in the opposite direction among the same obstacles."""
    twin = copy.deepcopy(world)
    behavior = twin["robot"]["behavior"]
    behavior["direction"] = -behavior["direction"]
    twin["robot"]["state"] = _start(behavior, world["world"], behavior["direction"])
    return twin


def write_world(world: World, path: Path) -> None:
    """Write a world as plain IR-SIM YAML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = "# Plain IR-SIM world: import repro.simulation.behaviors, irsim.make(this file), 100 times env.step().\n"
    path.write_text(header + yaml.safe_dump(world, sort_keys=False, default_flow_style=None), encoding="utf-8")


def shape_radius(shape: dict[str, Any]) -> float:
    """Compute the radius of the circle around the origin of an IR-SIM shape that encloses it [m]."""
    if shape["name"] == "circle":
        return float(shape["radius"])
    return math.hypot(shape["length"], shape["width"]) / 2


def _place_obstacles(rng, world: World, population: dict, clear_radius_m: float) -> list | None:
    """Draw shapes and place them without overlap, inside the map and outside the zone; None if one does not fit."""
    center = np.array([world["width"], world["height"]]) / 2
    placed: list[tuple[float, float, dict]] = []
    for _ in range(rng.integers(population["count"][0], population["count"][1] + 1)):
        shape = _shape(rng, population)
        radius = shape_radius(shape)
        for _ in range(_PLACEMENTS):
            x, y = rng.uniform(radius, 2 * center - radius)
            apart = all(math.hypot(x - u, y - v) >= radius + shape_radius(s) for u, v, s in placed)
            if apart and math.hypot(x - center[0], y - center[1]) >= clear_radius_m + radius:
                placed.append((float(x), float(y), shape))
                break
        else:
            return None
    return placed


def _shape(rng, population: dict) -> dict[str, Any]:
    """Draw a disc of random radius or a rectangle of the same area."""
    radius = rng.uniform(*population["radius_m"])
    is_disc, aspect = rng.random() < population["disc_share"], rng.uniform(*population["aspect"])
    if is_disc:
        return {"name": "circle", "radius": float(radius)}
    width = math.sqrt(math.pi * radius**2 / aspect)
    return {"name": "rectangle", "length": float(aspect * width), "width": float(width)}


def _obstacle(rng, spec: dict, x: float, y: float, shape: dict) -> dict[str, Any]:
    """Create one obstacle as IR-SIM reads it; a moving one has its own random stream."""
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
    """Return the start pose x, y [m], heading [rad].

    A rotation starts at the center, a square on its left side, `first_steps` before the corner below (direction 1) or
    above (direction -1).
    """
    center_x, center_y = world["width"] / 2, world["height"] / 2
    if motion["name"] == "rotate":
        return [center_x, center_y, 0.0]
    half = motion["side_m"] / 2
    ahead = motion["side_m"] * motion["first_steps"] / motion["drive_steps"]  # [m] to the first corner
    return [center_x - half, center_y - direction * (half - ahead), -direction * math.pi / 2]
