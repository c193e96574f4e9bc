"""Worlds: sampling from an experiment and a seed, reversal for the twin, and export as IR-SIM YAML.

A world is the plain dictionary that IR-SIM reads from YAML (`world`, `robot`, `obstacle`). After
`repro.simulation.behaviors` is imported, `irsim.make` loads the file that `write_world` writes and reproduces the
recorded scans.

Paper: "Simulation Approach". Unstated details: DEVIATIONS D1 to D6.
"""

import copy
import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml

from repro.simulation.motions import recorded_steps
from repro.simulation.paths import (
    check_path,
    is_drive,
    planned_path,
    reach_m,
    start_pose,
    to_waypoints,
    with_sampled_turn,
)
from repro.simulation.placement import Attempts, Site, sample_obstacles
from repro.simulation.rooms import check_rooms, sample_rooms
from repro.simulation.shapes import Line, boundaries, shape_radius, union
from repro.system.errors import InputError
from repro.system.files import write_text
from repro.world_config import lidar_of, populations

World = dict[str, Any]

_RESTARTS = 100  # attempts to sample one world


def sample_world(spec: dict[str, Any], seed: int) -> World:
    """Sample the world of one seed, with the robot moving counter-clockwise, or toward its goals.

    Args:
        spec: `world` and `robot` as IR-SIM reads them, `experiment` (its name), `motion` (the robot's
            behavior), `obstacles` (a population or several: `count`, `radius_m`, `aspect`, `disc_share`, or `shapes`,
            and, for moving obstacles, `behavior`), `clear_radius_m` (radius of the zone without obstacles),
            `fixed` (obstacles of every world, optional) and `rooms` (walls that differ from world to world, optional);
            see docs/worlds.md.
        seed: any non-negative integer; the same seed gives the same world.

    Raises:
        ValueError: the obstacles do not fit, or the robot would leave its zone or touch a fixed obstacle.
    """
    check_spec(spec)
    _check_room(spec)
    rng = np.random.default_rng([experiment_number(spec["experiment"]), seed])
    world, attempts = copy.deepcopy(spec["world"]), Attempts()
    for _ in range(_RESTARTS):
        rooms = sample_rooms(rng, spec["rooms"], world["width"]) if spec.get("rooms") else []
        fixed = fixed_obstacles(spec, rooms)
        walls, motion = union(fixed), spec["motion"]
        if motion["name"] == "random_goals":
            motion = to_waypoints(rng, motion, world, walls, spec["robot"]["shape"]["radius"])
        obstacles = sample_obstacles(rng, populations(spec), _site(spec, motion, walls, boundaries(fixed)), attempts)
        if obstacles is not None and (fixed or obstacles):
            break
    else:
        raise InputError(_no_room(spec))
    custom = {"fixed": len(fixed)} if fixed else {}
    if lidar_of(spec).get("noise"):
        custom["seed"] = 2 * int(rng.integers(2**30))
    motion = with_sampled_turn(rng, motion)  # last, so that obstacles and noise are those of the world without it
    robot = {**copy.deepcopy(spec["robot"]), "behavior": {**motion, "direction": 1}}
    robot["state"] = start_pose(motion, world, direction=1)
    sampled = {"world": world, "robot": robot, "obstacle": [*fixed, *obstacles]}
    return {**sampled, "custom": custom} if custom else sampled


def _site(spec: dict[str, Any], motion: dict[str, Any], walls: shapely.Geometry | None, lines: list[Line]) -> Site:
    """Describe where obstacles may stand in a world with this motion of the robot."""
    world = spec["world"]
    path = planned_path(motion, world)[:, :2] if is_drive(motion) else None
    size_m = np.array([world["width"], world["height"]])
    return Site(size_m, spec["clear_radius_m"], path, walls, lines, world["step_time"])


def fixed_obstacles(spec: dict[str, Any], rooms: Sequence[dict[str, Any]] = ()) -> list[dict[str, Any]]:
    """Return the obstacles of every world of an experiment, and the walls of rooms, as IR-SIM reads them."""
    return [
        {"shape": each["shape"], "state": each.get("state", [0.0, 0.0, 0.0]), "kinematics": {"name": "static"}}
        for each in copy.deepcopy([*spec.get("fixed", []), *rooms])
    ]


def experiment_number(experiment: str) -> int:
    """Return the number that enters the random seed of an experiment's worlds; for a non-numeric name, its hash."""
    if experiment.isdigit():
        return int(experiment)
    return int.from_bytes(hashlib.sha256(experiment.encode()).digest()[:8], "little")


def check_spec(spec: dict[str, Any]) -> None:
    """Check the combination of values: the map is square, and the robot stays in its zone and off fixed obstacles.

    Raises:
        ValueError: the map is not square, the robot would leave its zone or touch a fixed obstacle, or see
            `rooms.check_rooms`.
    """
    world, motion, clear_m = spec["world"], spec["motion"], spec["clear_radius_m"]
    radius_m = spec["robot"]["shape"].get("radius", 0)
    if world["width"] != world["height"]:
        raise InputError(
            f"the world must be square, got world.world.width={world['width']} and height={world['height']}"
        )
    if spec.get("rooms"):
        check_rooms(spec["rooms"], motion["name"], world["width"], 2 * radius_m)
    if motion["name"] != "random_goals":
        check_path(motion, world, union(fixed_obstacles(spec)), radius_m)
    if is_drive(motion):
        if 0 < clear_m < radius_m:
            raise InputError(f"clear_radius_m={clear_m} is less than the robot's radius of {radius_m} m")
        return
    reach = reach_m(motion, world) + radius_m
    if clear_m > 0 and reach > clear_m:
        raise InputError(
            f"the robot reaches {reach:.2f} m from the center, beyond its clear zone of clear_radius_m={clear_m}: "
            "make the zone larger or the motion smaller"
        )


def _check_room(spec: dict[str, Any]) -> None:
    """Check that the largest obstacles fit on the map, and that all of the smallest fit by their area.

    Raises:
        ValueError: they do not.
    """
    width, clear_m, area = spec["world"]["width"], spec["clear_radius_m"], 0.0
    for population in populations(spec):
        if "shapes" in population:
            radii = [shape_radius(shape) for shape in population["shapes"]]
            smallest, largest = min(radii), max(radii)
        else:
            stretch = max(math.sqrt(math.pi * (ratio + 1 / ratio)) / 2 for ratio in population["aspect"])  # rectangles
            smallest = population["radius_m"][0]
            largest = population["radius_m"][1] * (stretch if population["disc_share"] < 1 else 1)
        area += population["count"][0] * math.pi * smallest**2
        if 2 * largest > width:
            raise InputError(_no_room(spec))
    if area > width**2 - math.pi * min(clear_m, width / 2) ** 2:
        raise InputError(_no_room(spec))


def _no_room(spec: dict[str, Any]) -> str:
    if not populations(spec):
        return f"rooms with sides of {spec['rooms']['side_m']} m have no wall on the map: use shorter sides"
    wanted = [
        f"{population['count']} obstacles of "
        + (
            f"{len(population['shapes'])} shapes"
            if "shapes" in population
            else f"radius {population['radius_m']} m and aspect {population['aspect']}"
        )
        for population in populations(spec)
    ]
    place = "the robot" if is_drive(spec["motion"]) else "the center"
    return (
        f"no room for {' and '.join(wanted)} outside {spec['clear_radius_m']} m of {place}: use fewer or smaller "
        "obstacles, or a smaller clear_radius_m"
    )


def reverse_direction(world: World) -> World:
    """Create the twin: the robot moves in the opposite direction among the same obstacles, with other noise."""
    twin = copy.deepcopy(world)
    behavior = twin["robot"]["behavior"]
    behavior["direction"] = -behavior["direction"]
    twin["robot"]["state"] = start_pose(behavior, world["world"], behavior["direction"])
    if "seed" in twin.get("custom", {}):
        twin["custom"]["seed"] ^= 1
    return twin


def write_world(world: World, path: Path) -> None:
    """Write a world as plain IR-SIM YAML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    noise_seed, steps = world.get("custom", {}).get("seed"), recorded_steps(world["robot"]["behavior"])
    arguments = "this file" if noise_seed is None else f"this file, seed={noise_seed}"
    header = (
        f"# Plain IR-SIM world: import repro.simulation.behaviors, irsim.make({arguments}), {steps} times env.step().\n"
    )
    write_text(path, header + yaml.safe_dump(world, sort_keys=False, default_flow_style=None))
