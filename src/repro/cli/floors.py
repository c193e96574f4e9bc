"""A world like the office with the floor of a map of map_server, as a file of conf/world.

The world has the robot, the populations and the experiments of the office, for the user to edit.
"""

import re
from pathlib import Path

import yaml

from repro.simulation.floors import Floor, read_floor
from repro.system.errors import InputError
from repro.system.files import write_text
from repro.system.places import conf_directory


def write_floor(floor_map: str) -> None:
    """Write the world and print its path, and the center of the map for predictions.

    Args:
        floor_map: the YAML of a map of map_server.

    Raises:
        InputError: the map cannot be converted, or a world of this name exists.
    """
    source = Path(floor_map)
    name = re.sub(r"[^A-Za-z0-9_-]", "_", source.stem)
    path = conf_directory() / "world" / f"{name}.yaml"
    if path.exists():
        raise InputError(f"{path} exists: rename {source}, or delete that world")
    floor = read_floor(source)
    title = "".join(each if each.isprintable() else "?" for each in source.name)
    write_text(path, world_file(floor, title))
    x, y = floor.center
    print(f"{path}: {len(floor.obstacles)} polygons on {floor.width_m:g} x {floor.width_m:g} m")
    print("edit its robot, populations and experiments, which are those of the office")
    print(f"a figure of it: python run.py task=world world={name} exp=people outputs=outputs/{name}")
    print(f"in the frame of {title}, its center is prediction.center=[{x:g},{y:g}]")


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
    world = {"world": {"height": floor.width_m, "width": floor.width_m}, "fixed": {"floor": floor.obstacles}}
    content = {"defaults": ["office", "_self_"], **world}
    return header + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
