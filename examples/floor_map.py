"""The floor of a map of map_server as a world of this project, for training in your own building.

python examples/floor_map.py maps/first_floor.yaml

The largest connected area of free cells is the floor. Polygons cover all other cells exactly: occupied and unknown
ones, areas behind walls, and the margin to the right of the map or above it that makes the world a square. The new file
in conf/world takes the robot, the populations and the experiments of the office: add the keys that differ.
"""

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import shapely
import yaml
from PIL import Image
from pydantic import Field
from scipy import ndimage

from repro.system.errors import InputError
from repro.system.fields import Finite
from repro.system.files import check_regular, read_typed, write_text
from repro.system.project import conf_directory
from repro.worlds.obstacles import MAX_FIXED, MAX_VERTICES

MAX_CELLS = 10_000  # along one side of a map
Position = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]  # [m]; float64 resolves a millimeter there
UNKNOWN = 205  # gray of an unknown cell from map_saver, which Nav2's default free_thresh would take for free


@dataclass(frozen=True)
class MapFile:
    """What is needed from the YAML of a map, with the names and defaults of map_server; other keys are allowed."""

    image: str
    resolution: Annotated[float, Field(gt=0, le=100)]  # side of a cell [m]
    origin: tuple[Position, Position, Finite]  # lower left corner x, y [m], heading [rad]
    negate: Literal[0, 1] = 0
    free_thresh: Annotated[float, Field(gt=0, le=1)] = 0.25
    mode: Literal["trinary", "scale"] = "trinary"


def floor_of(path: Path) -> tuple[list[np.ndarray], float, tuple[float, float]]:
    """Convert a map, whose YAML names its image.

    Returns:
        polygons that cover all cells but the floor [m], from the lower left corner of the map, each (V, 2); the side of
        the square that they fill [m]; and its center in the frame of the map, x, y [m].

    Raises:
        InputError: the map cannot be read, is rotated, has no free cell, or needs too many polygons.
    """
    content = read_typed(MapFile, path, "expected the YAML of a map of map_server")
    x, y, heading = content.origin
    if heading != 0:
        raise InputError(f"{path}: expected an origin with heading 0, got {heading}: rotate the map")
    areas, count = ndimage.label(_free_cells(path.parent / content.image, content))
    if not count:
        raise InputError(f"{path}: expected a map with free cells, got none: check negate and free_thresh")
    floor = areas == 1 + np.argmax(np.bincount(areas.flat)[1:])
    side = max(floor.shape)
    solid = np.ones((side, side), dtype=bool)  # row 0 at the bottom
    solid[: floor.shape[0], : floor.shape[1]] = ~floor[::-1]
    least = _fewest_polygons(solid)
    pieces = list(_pieces(_outline(solid))) if least <= MAX_FIXED else []
    if (count := max(least, len(pieces))) > MAX_FIXED:
        raise InputError(f"{path}: expected at most {MAX_FIXED} polygons, got {count} or more: remove specks of noise")
    outlines = [np.asarray(piece.exterior.coords)[:-1] * content.resolution for piece in pieces]
    width = side * content.resolution
    return outlines, width, (x + width / 2, y + width / 2)


def _free_cells(path: Path, content: MapFile) -> np.ndarray:
    """Return which cells of an image are free, (H, W), row 0 at the top. Source: nav2_map_server, map_io.cpp."""
    try:
        check_regular(path)
        with Image.open(path, formats=("PNG", "PPM", "BMP")) as image:  # others may start programs
            if max(image.size) > MAX_CELLS:
                raise InputError(f"{image.size} cells, expected at most {MAX_CELLS} along a side")
            if image.mode not in ("1", "L", "P", "RGB") or image.has_transparency_data:
                raise InputError(f"it has Pillow's mode {image.mode}, convert it to 8 bits without transparency")
            gray = np.asarray(image.convert("L"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} cannot be read as PNG, PGM or BMP: {error}") from error
    occupied = (gray if content.negate else 255 - gray) / 255
    return (occupied < content.free_thresh) & ~((gray == UNKNOWN) & (content.mode == "trinary"))


def _fewest_polygons(solid: np.ndarray) -> int:
    """Return a lower bound of the polygons that cover cells (H, W), by connected areas and by corners."""
    corners = solid[1:, 1:] ^ solid[1:, :-1] ^ solid[:-1, 1:] ^ solid[:-1, :-1]
    return max(ndimage.label(solid)[1], int(corners.sum()) // MAX_VERTICES)


def _outline(solid: np.ndarray) -> shapely.Geometry:
    """Return the union of cells (H, W), row 0 at the bottom, in units of a cell, without superfluous vertices."""
    boxes = []
    for row, cells in enumerate(solid):
        edges = np.flatnonzero(np.diff(cells, prepend=False, append=False))
        boxes += [shapely.box(left, row, right, row + 1) for left, right in edges.reshape(-1, 2)]
    return shapely.union_all(boxes).simplify(0)


def _pieces(area: shapely.Geometry) -> Iterator[shapely.Polygon]:
    """Cut an area of whole cells in halves until every part is a polygon without holes and of few vertices."""
    for part in shapely.get_parts(area):
        if not isinstance(part, shapely.Polygon):  # a point or line at which two halves touch
            continue
        if not part.interiors and len(part.exterior.coords) <= MAX_VERTICES:
            yield part
            continue
        left, bottom, right, top = part.bounds
        if right - left > top - bottom:
            right = (left + right) // 2
        else:
            top = (bottom + top) // 2
        low = shapely.box(left, bottom, right, top)
        yield from _pieces(part.intersection(low))
        yield from _pieces(part.difference(low))


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", type=Path, help="the YAML of the map")
    source = parser.parse_args().map
    name = re.sub(r"^(?=\d)|[^A-Za-z0-9_-]", "_", source.stem)  # not a number
    target = conf_directory() / "world" / f"{name}.yaml"
    try:
        if target.exists():
            raise InputError(f"{target} exists: rename {source}, or delete that world")
        outlines, width, (x, y) = floor_of(source)
    except InputError as error:
        parser.error(str(error))
    fixed = [{"shape": {"name": "polygon", "vertices": outline.round(4).tolist()}} for outline in outlines]
    size = {"height": round(width, 4), "width": round(width, 4)}
    world = {"defaults": ["office", "_self_"], "world": size, "fixed": {"floor": fixed}}
    write_text(target, yaml.safe_dump(world, sort_keys=False, default_flow_style=None))
    print(f"{target}: {len(outlines)} polygons on {width:g} x {width:g} m")
    print(f"a figure of it: python run.py task=world world={name} exp=people outputs=outputs/{name}")
    print(f"in the frame of the map, its center is prediction.center=[{x:.4f},{y:.4f}]")


if __name__ == "__main__":
    main()
