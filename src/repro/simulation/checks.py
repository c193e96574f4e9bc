"""Errors of a whole file of conf/world: of single values, and of combinations that cannot be recorded."""

from typing import Any

import shapely

from repro.simulation.paths import top_speeds
from repro.simulation.sampling import check_spec, fixed_obstacles, sample_world, smallest_radius
from repro.simulation.shapes import geometry
from repro.system.errors import InputError
from repro.system.fields import ConfigError, WrongValues
from repro.worlds.spec import WorldFile, WorldSpec

MAX_STEPS = 30_000  # of a recording; ages of pixels are stored in 16 bits
SAMPLED = 4  # worlds that a configuration must have room for; recording samples the others
MAX_READINGS = 2_000_000  # of a recording; a shard of a hundred recordings is held in memory, 4 bytes each


def checked_world(values: dict[str, Any]) -> WorldFile:
    """Return the typed content of a file of conf/world, whose worlds can be recorded.

    Args:
        values: the section `world` of the configuration, as plain values.

    Raises:
        WrongValues: single values are wrong, or their combination in an experiment.
    """
    if "experiments" not in values:
        expected = "is missing; worlds are sampled from the keys in docs/worlds.md, a plain world of IR-SIM is not read"
        raise WrongValues(ConfigError("world.experiments", None, expected))
    names = values["experiments"]
    if isinstance(names, dict) and (numbers := [name for name in names if not isinstance(name, str)]):
        expected = f'names are strings: write "{numbers[0]}" in the YAML'
        raise WrongValues(ConfigError("world.experiments", numbers, expected))
    world = WorldFile.parse(values)
    found = {name: _error_of_spec(spec) for name, spec in world.specs.items()}
    if errors := [ConfigError(f"world.experiments.{name}", None, text) for name, text in found.items() if text]:
        raise WrongValues(*errors)
    return world


def _error_of_spec(spec: WorldSpec) -> str | None:
    """Return an error in the combination of the values of an experiment; None without one."""
    step_time, steps, width, beams = spec.world.step_time, spec.steps, spec.world.width, spec.lidar.number
    try:
        if steps * beams > MAX_READINGS:
            return f"{steps} steps of {beams} beams are more than {MAX_READINGS} readings: use fewer"
        if steps > MAX_STEPS:
            return f"a recording of {steps} steps is longer than {MAX_STEPS}: use fewer"
        speeds = top_speeds(spec.motion, step_time)
        check_spec(spec)
        for number, obstacle in enumerate(fixed_obstacles(spec), start=1):
            if not geometry(obstacle["shape"], obstacle["state"]).intersects(shapely.box(0, 0, width, width)):
                return f"fixed obstacle {number} is outside the map of {width:g} x {width:g} m"
        fastest = max((behavior.speed_m_s[1] for behavior in spec.behaviors), default=0.0)
        if fastest * step_time * steps > width:
            return (
                f"obstacles of {fastest} m/s would cross the whole map of {width:g} m in {steps * step_time:g} s: make "
                "them slower or the window shorter"
            )
        if message := _error_of_steps(spec):
            return message
        if (speeds > spec.robot.vel_max).any() or (-speeds < spec.robot.vel_min).any():
            limits = f"vel_min {list(spec.robot.vel_min)}, vel_max {list(spec.robot.vel_max)}"
            return f"the robot needs {speeds.round(3).tolist()} m/s, rad/s both ways, beyond its {limits}"
        for seed in range(SAMPLED):
            sample_world(spec, seed)
    except InputError as error:
        return str(error)
    return None


def _error_of_steps(spec: WorldSpec) -> str | None:
    """Return an error if moving obstacles may pass through thin standing ones within a step; None without one.

    Obstacles stop short of walls by their radius at the end of every step, so a step of less than twice the radius
    cannot cross a wall.
    """
    if not spec.fixed and not spec.rooms and all(population.behavior for population in spec.populations):
        return None
    for population in spec.populations:
        if population.behavior:
            fastest, smallest_m = population.behavior.speed_m_s[1], smallest_radius(population)
            step_m = fastest * spec.world.step_time
            if step_m >= 2 * smallest_m:
                return (
                    f"obstacles of {fastest:g} m/s and a radius of {smallest_m:g} m move {step_m:g} m in a step and "
                    f"may pass through walls: expected less than {2 * smallest_m:g} m, twice their smallest radius: "
                    "make them slower or larger, or step_time shorter"
                )
    return None
