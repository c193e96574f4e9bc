"""Floors from maps of map_server: all cells that are not free as fixed obstacles of a world."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import shapely
from PIL import Image
from pydantic import Field
from pydantic.dataclasses import dataclass as checked
from scipy import ndimage

from repro.fields import Finite
from repro.simulation.shapes import Obstacle
from repro.system.errors import InputError
from repro.system.files import check_regular, read_typed
from repro.world_obstacles import MAX_FIXED, MAX_VERTICES

MAX_CELLS = 10_000  # along one side of a map
FORMATS = ("PNG", "PPM", "BMP")  # of images; PPM includes PGM. Others may start programs.
MODES = ("1", "L", "P", "RGB")  # of images with up to 8 bits per color; map_server takes transparent cells as unknown
Position = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]  # [m]; float64 resolves a millimeter there
UNKNOWN = 205  # gray of an unknown cell from map_saver, which Nav2's default free_thresh would take for free


@dataclass(frozen=True)
class Floor:
    """The fixed obstacles of a square world, whose origin is the lower left corner of the map.

    Args:
        obstacles: polygons in the frame of the world [m].
        width_m: side of the world [m].
        center: center of the world in the frame of the map, x, y [m].
    """

    obstacles: list[Obstacle]
    width_m: float
    center: tuple[float, float]


@checked
class MapFile:
    """What is needed from the YAML of a map; the names are those of map_server, and other keys are allowed."""

    image: str
    resolution: Annotated[float, Field(gt=0, le=100)]  # side of a cell [m]
    origin: tuple[Position, Position, Finite]  # lower left corner x, y [m], heading [rad]
    negate: Literal[0, 1] = 0
    free_thresh: Annotated[float, Field(gt=0, le=1)] = 0.25
    mode: Literal["trinary", "scale"] = "trinary"


def read_floor(path: Path) -> Floor:
    """Convert a map to fixed obstacles.

    The largest connected area of free cells is the floor. Polygons cover all other cells exactly: occupied and unknown
    ones, areas behind walls, and the margin to the right of the map or above it that makes the world a square.

    Args:
        path: the YAML of the map, which names its image.

    Raises:
        ValueError: the map cannot be read, is rotated, has no free cell, or needs too many polygons.

    Source: nav2_map_server, map_io.cpp.
    """
    content = read_typed(MapFile, path, "floor_map= takes the YAML of a map of map_server")
    if content.origin[2] != 0:
        raise InputError(f"{path}: expected an origin with heading 0, got {content.origin[2]}: rotate the map")
    free = _largest_area(_free_cells(path.parent / content.image, content), path)
    side = max(free.shape)
    solid = np.ones((side, side), dtype=bool)  # row 0 at the bottom
    solid[: free.shape[0], : free.shape[1]] = ~free[::-1]
    _check_polygons(_fewest_polygons(solid), path)
    polygons = list(_pieces(_outline(solid)))
    _check_polygons(len(polygons), path)
    outlines = [np.asarray(polygon.exterior.coords)[:-1] * content.resolution for polygon in polygons]
    width = side * content.resolution
    return Floor(
        obstacles=[{"shape": {"name": "polygon", "vertices": outline.round(4).tolist()}} for outline in outlines],
        width_m=round(width, 4),
        center=(round(content.origin[0] + width / 2, 4), round(content.origin[1] + width / 2, 4)),
    )


def _free_cells(path: Path, content: MapFile) -> np.ndarray:
    """Return which cells of an image are free, (H, W), row 0 at the top."""
    gray = _read_image(path)
    occupied = (gray if content.negate else 255 - gray) / 255
    is_unknown = (gray == UNKNOWN) & (content.mode == "trinary")
    return (occupied < content.free_thresh) & ~is_unknown


def _read_image(path: Path) -> np.ndarray:
    """Return the gray of the cells, 0 to 255, (H, W)."""
    try:
        check_regular(path)
        with Image.open(path, formats=FORMATS) as image:
            if max(image.size) > MAX_CELLS:
                raise InputError(f"{image.size} cells, expected at most {MAX_CELLS} along a side")
            if image.mode not in MODES or image.has_transparency_data:  # grays of 16 bits would be cut off at 255
                raise InputError(f"it has Pillow's mode {image.mode}, convert it to 8 bits without transparency")
            return np.asarray(image.convert("L"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        expected = ", ".join(FORMATS)
        raise InputError(f"{path} cannot be read as an image, expected one of {expected}: {error}") from error


def _largest_area(free: np.ndarray, path: Path) -> np.ndarray:
    """Return which cells belong to the largest area of free cells that touch along their sides."""
    areas, count = ndimage.label(free)
    if not count:
        raise InputError(f"{path}: expected a map with free cells, got none: check negate and free_thresh")
    return areas == 1 + np.argmax(np.bincount(areas.flat)[1:])


def _check_polygons(count: int, path: Path) -> None:
    if count > MAX_FIXED:
        raise InputError(f"{path}: expected at most {MAX_FIXED} polygons, got {count} or more: remove specks of noise")


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
            middle = (left + right) // 2
            halves = shapely.box(left, bottom, middle, top), shapely.box(middle, bottom, right, top)
        else:
            middle = (bottom + top) // 2
            halves = shapely.box(left, bottom, right, middle), shapely.box(left, middle, right, top)
        for half in halves:
            yield from _pieces(part.intersection(half))
