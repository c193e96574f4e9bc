"""task=floor: a world like the office with the floor of a map of map_server, in conf/world.

The world has the robot, the populations and the experiments of the office, for the user to edit.
"""

import re
from pathlib import Path

import yaml

from repro.cli.composition import CONF
from repro.cli.jobs import Job
from repro.simulation.floors import Floor, read_floor
from repro.system.files import write_text


def run(job: Job) -> None:
    """Write the world and print its path, and the center of the map for predictions.

    Raises:
        ValueError: the map cannot be converted, or a world of this name exists.
    """
    assert job.call.floor_map is not None
    source = Path(job.call.floor_map)
    name = re.sub(r"[^A-Za-z0-9_-]", "_", source.stem)
    path = CONF / "world" / f"{name}.yaml"
    if path.exists():
        raise ValueError(f"{path} exists: rename {source}, or delete that world")
    floor = read_floor(source)
    write_text(path, world_file(floor, source.name))
    x, y = floor.center
    print(f"{path}: {len(floor.obstacles)} polygons on {floor.width_m:g} x {floor.width_m:g} m")
    print(f"a figure of it: python run.py task=world world={name} exp=people outputs=outputs/{name}")
    print(f"in the frame of {source.name}, its center is prediction.center=[{x:g},{y:g}]")


def world_file(floor: Floor, source: str) -> str:
    """Return the YAML of the world."""
    x, y = floor.center
    content = {
        "defaults": ["office", "_self_"],
        "world": {"height": floor.width_m, "width": floor.width_m},
        "fixed": {"floor": floor.obstacles},
    }
    header = (
        f"# The floor of {source}; its center is x = {x:g}, y = {y:g} m in the frame of that map.\n"
        "# Robot, populations and experiments are those of office.yaml: add the keys that differ.\n"
    )
    return header + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
