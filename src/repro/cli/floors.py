"""A world like the office with the floor of a map of map_server, as a file of conf/world.

The world has the robot, the populations and the experiments of the office, for the user to edit.
"""

import re
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf

from repro.simulation.floors import Floor, read_floor
from repro.simulation.schema import world_errors
from repro.system.errors import InputError
from repro.system.files import write_text
from repro.system.places import conf_directory
from repro.world_config import plain

OFFICE = conf_directory() / "world" / "office.yaml"
NO_STRING = re.compile(r"[+-]?(\d[\d_]*(e[+-]?\d[\d_]*)?|inf|nan)|null|true|false", re.IGNORECASE)  # as world=...


def write_floor(floor_map: str) -> None:
    """Write the world and print its path, and the center of the map for predictions.

    Args:
        floor_map: the YAML of a map of map_server.

    Raises:
        InputError: the map cannot be converted, no world has its floor, or a world of this name exists.
    """
    source = Path(floor_map)
    name = world_name(source.stem)
    path = conf_directory() / "world" / f"{name}.yaml"
    if path.exists():
        raise InputError(f"{path} exists: rename {source}, or delete that world")
    floor = read_floor(source)
    note = _check(floor, source)
    title = "".join(each if each.isprintable() else "?" for each in source.name)
    write_text(path, world_file(floor, title))
    x, y = floor.center
    print(f"{path}: {len(floor.obstacles)} polygons on {floor.width_m:g} x {floor.width_m:g} m")
    if note:
        print(f"edit its robot, populations or experiments, those of the office do not fit: {note}")
    print(f"a figure of it: python run.py task=world world={name} exp=people outputs=outputs/{name}")
    print(f"in the frame of {title}, its center is prediction.center=[{x:g},{y:g}]")


def world_name(stem: str) -> str:
    """Return a name of a world that `world=` reads as a string."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", stem)
    return f"floor_{name}" if NO_STRING.fullmatch(name) else name


def world_file(floor: Floor, source: str) -> str:
    """Return the YAML of the world.

    Args:
        floor: the floor.
        source: name of its map, in one line.
    """
    x, y = floor.center
    header = (
        f"# The floor of {source}; its center is x = {x:g}, y = {y:g} m in the frame of that map.\n"
        "# Robot, populations and experiments are those of office.yaml: add the keys that differ.\n"
    )
    content = {"defaults": ["office", "_self_"], **_own_keys(floor)}
    return header + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)


def _own_keys(floor: Floor) -> dict[str, Any]:
    """Return the keys of the world that differ from the office."""
    return {"world": {"height": floor.width_m, "width": floor.width_m}, "fixed": {"floor": floor.obstacles}}


def _check(floor: Floor, source: Path) -> str | None:
    """Check that a world can have the floor, and return what is in the way of the populations of the office, if any.

    Raises:
        ValueError: no world can have the floor, even without populations.
    """
    world = plain(OmegaConf.create({"world": OmegaConf.merge(OmegaConf.load(OFFICE), _own_keys(floor))}))["world"]
    errors = world_errors(world)
    if not errors:
        return None
    empty = {name: {**experiment, "obstacles": []} for name, experiment in world["experiments"].items()}
    if reasons := world_errors({**world, "experiments": empty}):
        raise InputError(f"{source}: its floor of {floor.width_m:g} x {floor.width_m:g} m makes no world: {reasons[0]}")
    return str(errors[0])
