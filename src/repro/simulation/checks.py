"""Errors of a whole file of conf/world: of single values, and of combinations that cannot be recorded."""

import json
import re
from typing import Any

import shapely
from pydantic import ValidationError

from repro.simulation.sampling import check_spec, fixed_obstacles, sample_world, smallest_radius
from repro.simulation.shapes import geometry
from repro.system.errors import InputError
from repro.system.fields import ConfigError, config_errors_of
from repro.worlds.spec import WorldFile, WorldSpec, world_spec

MAX_STEPS = 30_000  # of a recording; ages of pixels are stored in 16 bits
SAMPLED = 4  # worlds that a configuration must have room for; recording samples the others
MAX_READINGS = 2_000_000  # of a recording; a shard of a hundred recordings is held in memory, 4 bytes each


def world_errors(world: dict[str, Any]) -> list[ConfigError]:
    """Return all config errors of `world`: first of single values, then of their combinations.

    Args:
        world: the section `world` of the configuration, as plain values.

    Returns:
        the config errors; empty if the worlds of every experiment can be recorded.
    """
    if "experiments" not in world:
        expected = "is missing; worlds are sampled from the keys in docs/worlds.md, a plain world of IR-SIM is not read"
        return [ConfigError("world.experiments", None, expected)]
    if isinstance(world["experiments"], dict) and (
        numbers := [key for key in world["experiments"] if not isinstance(key, str)]
    ):
        return [ConfigError("world.experiments", numbers, f'names are strings: write "{numbers[0]}" in the YAML')]
    try:
        # JSON, for strict types and lists where the schema has tuples; other values of YAML become text
        WorldFile.model_validate_json(json.dumps(world, default=str))
    except ValidationError as error:
        return _once(config_errors_of(error, "world."))
    errors = []
    for name in world["experiments"]:
        message = _error_of_spec(world_spec(world, name))
        if message:
            errors.append(ConfigError(f"world.experiments.{name}", None, message))
    return errors


_TAG = re.compile(  # that pydantic adds to the path of a value in a union, where it is not the user's name of a part
    r"(?<!motions)(?<!obstacles)(?<!fixed)(?<!rooms)(?<!experiments)\.(<\w+>|rotate|square|waypoints|random_goals|drift|"
    r"walk|circle|rectangle|polygon|linestring)(?=\.|$)"
)


def _once(errors: list[ConfigError]) -> list[ConfigError]:
    """Drop pydantic's union tags, and errors of experiments until all parts are right to which they may refer."""
    plain = [ConfigError(_TAG.sub("", error.key), error.value, error.expected) for error in errors]
    return [error for error in plain if not error.key.startswith("world.experiments.")] or plain


def _error_of_spec(spec: WorldSpec) -> str | None:
    """Return an error in the combination of the values of an experiment; None without one."""
    step_time, steps, width, beams = spec.world.step_time, spec.steps, spec.world.width, spec.lidar.number
    try:
        if steps * beams > MAX_READINGS:
            return f"{steps} steps of {beams} beams are more than {MAX_READINGS} readings: use fewer"
        if steps > MAX_STEPS:
            return f"a recording of {steps} steps is longer than {MAX_STEPS}: use fewer"
        speeds = spec.motion.top_speeds(step_time)
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
