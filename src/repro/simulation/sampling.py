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
import shapely
import yaml

from repro.simulation.paths import Behavior, check_path, farthest_m, planned_path, sampled_behavior, to_waypoints
from repro.simulation.placement import Attempts, Site, sample_obstacles
from repro.simulation.rooms import check_rooms, sample_rooms
from repro.simulation.shapes import Line, Obstacle, boundaries, filled, shape_radius, standing, union
from repro.system.errors import InputError
from repro.system.files import write_text
from repro.worlds.obstacles import Shaped, Sized
from repro.worlds.robot_motions import FullTurn, RandomGoals, Square, drive_of
from repro.worlds.spec import WorldSpec

World = dict[str, Any]

_RESTARTS = 100  # attempts to sample one world


def sample_world(spec: WorldSpec, seed: int) -> World:
    """Sample the world of one seed, with the robot moving counter-clockwise, or toward its goals.

    Args:
        spec: what decides the worlds; see docs/worlds.md.
        seed: any non-negative integer; the same seed gives the same world.

    Raises:
        InputError: the obstacles do not fit, or the robot would leave its zone or touch a fixed obstacle.
    """
    check_spec(spec)
    width = spec.world.width
    least_area = sum(
        population.count[0] * math.pi * smallest_radius(population) ** 2 for population in spec.populations
    )
    if least_area > width**2 - math.pi * min(spec.clear_radius_m, width / 2) ** 2:
        raise InputError(_no_room(spec))  # the attempts below would take seconds
    rng = np.random.default_rng([experiment_number(spec.experiment), seed])
    attempts = Attempts()
    for _ in range(_RESTARTS):
        fixed = sample_fixed(rng, spec)
        given = len(spec.fixed)
        walls = union([*fixed[:given], *map(filled, fixed[given:])])  # nobody starts in thick walls and cabinets
        drive = _sample_drive(rng, spec, walls)
        site = _site(spec, drive, walls, boundaries(fixed))
        obstacles = sample_obstacles(rng, spec.populations, site, attempts)
        if obstacles is not None and (fixed or obstacles):
            break
    else:
        raise InputError(_no_room(spec))
    custom = {"fixed": len(fixed)} if fixed else {}
    if spec.lidar.noise:
        custom["seed"] = 2 * int(rng.integers(2**30))
    behavior = drive or sampled_behavior(rng, spec.motion)  # a turn, drawn last, leaves obstacles and noise as they are
    state = drive_of(behavior).start(spec.world.width, spec.world.step_time)
    robot = {**spec.robot.irsim(), "behavior": behavior, "state": state}
    sampled = {"world": spec.world.irsim(), "robot": robot, "obstacle": [*fixed, *obstacles]}
    return {**sampled, "custom": custom} if custom else sampled


def _sample_drive(rng: np.random.Generator, spec: WorldSpec, walls: shapely.Geometry | None) -> Behavior | None:
    """Return how the robot drives through the map; None if it stays in a zone at the center."""
    if isinstance(spec.motion, RandomGoals):
        return to_waypoints(rng, spec.motion, spec.world, walls, spec.robot.shape.radius)
    return sampled_behavior(rng, spec.motion) if spec.is_drive else None


def _site(spec: WorldSpec, drive: Behavior | None, walls: shapely.Geometry | None, lines: list[Line]) -> Site:
    """Describe where obstacles may stand in a world, in which the robot drives through the map or stays in its zone."""
    world = spec.world
    path = planned_path(drive, world)[:, :2] if drive else None
    return Site(np.array([world.width, world.height]), spec.clear_radius_m, path, walls, lines, world.step_time)


def fixed_obstacles(spec: WorldSpec) -> list[Obstacle]:
    """Return the obstacles of every world of an experiment, as IR-SIM reads them."""
    return [standing(obstacle.shape.irsim(), obstacle.state) for obstacle in spec.fixed]


def sample_fixed(rng: np.random.Generator, spec: WorldSpec) -> list[Obstacle]:
    """Return the fixed obstacles of one world: those of all worlds, and the walls of its rooms."""
    rooms = sample_rooms(rng, spec.rooms, spec.world.width) if spec.rooms else []
    return [*fixed_obstacles(spec), *rooms]


def experiment_number(experiment: str) -> int:
    """Return the number that enters the random seed of an experiment's worlds; for a non-numeric name, its hash."""
    if experiment.isdigit():
        return int(experiment)
    return int.from_bytes(hashlib.sha256(experiment.encode()).digest()[:8], "little")


def check_spec(spec: WorldSpec) -> None:
    """Check the combination of values: the map is square, and the robot stays in its zone and off fixed obstacles.

    Raises:
        InputError: the map is not square, the robot would leave its zone or touch a fixed obstacle, or see
            `rooms.check_rooms`.
    """
    world, motion, clear_m, radius_m = spec.world, spec.motion, spec.clear_radius_m, spec.robot.shape.radius
    if world.width != world.height:
        raise InputError(f"the world must be square, got world.world.width={world.width:g} and height={world.height:g}")
    if spec.rooms:
        check_rooms(spec.rooms, motion, world.width, 2 * radius_m)
    if not isinstance(motion, RandomGoals):
        check_path(motion, world, union(fixed_obstacles(spec)), radius_m)
    if not isinstance(motion, FullTurn | Square):
        if 0 < clear_m < radius_m:
            raise InputError(f"clear_radius_m={clear_m} is less than the robot's radius of {radius_m} m")
        return
    farthest = farthest_m(motion, world) + radius_m
    if clear_m > 0 and farthest > clear_m:
        raise InputError(
            f"the robot reaches {farthest:.2f} m from the center, beyond its clear zone of clear_radius_m={clear_m}: "
            "make the zone larger or the motion smaller"
        )


def smallest_radius(population: Sized | Shaped) -> float:
    """Return the least radius of the obstacles of a population [m]; of discs and rectangles, that of the disc."""
    if isinstance(population, Shaped):
        return min(shape_radius(shape.irsim()) for shape in population.shapes)
    return population.radius_m[0]


def _no_room(spec: WorldSpec) -> str:
    if spec.rooms and not spec.populations:
        return f"rooms with sides of {list(spec.rooms.side_m)} m have no wall on the map: use shorter sides"
    wanted = [
        f"{list(population.count)} obstacles of "
        + (
            f"{len(population.shapes)} shapes"
            if isinstance(population, Shaped)
            else f"radius {list(population.radius_m)} m and aspect {list(population.aspect)}"
        )
        for population in spec.populations
    ]
    place = "the robot" if spec.is_drive else "the center"
    return (
        f"no room for {' and '.join(wanted)} outside {spec.clear_radius_m} m of {place}: use fewer or smaller "
        "obstacles, or a smaller clear_radius_m"
    )


def reverse_direction(world: World) -> World:
    """Create the twin: the robot moves in the opposite direction among the same obstacles, with other noise."""
    twin = {**world, "robot": copy.deepcopy(world["robot"])}
    behavior = twin["robot"]["behavior"]
    behavior["direction"] = -behavior["direction"]
    twin["robot"]["state"] = drive_of(behavior).start(world["world"]["width"], world["world"]["step_time"])
    if "seed" in twin.get("custom", {}):
        twin["custom"] = {**world["custom"], "seed": world["custom"]["seed"] ^ 1}
    return twin


def write_world(world: World, path: Path) -> None:
    """Write a world as plain IR-SIM YAML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    noise_seed, steps = world.get("custom", {}).get("seed"), drive_of(world["robot"]["behavior"]).steps
    arguments = "this file" if noise_seed is None else f"this file, seed={noise_seed}"
    header = (
        f"# Plain IR-SIM world: import repro.simulation.behaviors, irsim.make({arguments}), {steps} times env.step().\n"
    )
    write_text(path, header + yaml.safe_dump(world, sort_keys=False, default_flow_style=None))
