"""The example that makes a world of a map of map_server: which cells the polygons cover, and what is refused."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from conftest import ROOT, read_calls
from PIL import Image

from repro.simulation.sampling import sample_world

SPEC = importlib.util.spec_from_file_location("floor_map", ROOT / "examples" / "floor_map.py")
floor_map = importlib.util.module_from_spec(SPEC)
sys.modules["floor_map"] = floor_map
SPEC.loader.exec_module(floor_map)

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
CELL = 0.25


def write(directory: Path, cells: np.ndarray, **keys: object) -> Path:
    """Write a map, row 0 at the top."""
    Image.fromarray(cells).save(directory / "map.pgm")
    content = {"image": "map.pgm", "resolution": CELL, "origin": [-3.0, 2.0, 0.0], "occupied_thresh": 0.65}
    path = directory / "my map.yaml"
    path.write_text(yaml.safe_dump({**content, **keys}))
    return path


def rooms() -> np.ndarray:
    """Return a map of two rooms with a slanted wall, pillars that touch at a corner, and free cells behind a wall."""
    cells = np.full((60, 80), UNKNOWN, dtype=np.uint8)
    cells[5:55, 5:75] = FREE
    rows, columns = np.indices(cells.shape)
    cells[abs(rows + columns // 3 - 60) < 2] = OCCUPIED  # slanted
    cells[42:52, 36:46] = FREE  # a door
    cells[10:12, 10:12] = cells[12:14, 12:14] = OCCUPIED
    cells[20:30, 20:30] = OCCUPIED
    cells[22:28, 22:28] = FREE
    return cells


def covered(outlines: list) -> np.ndarray:
    """Return which cells have their center in a polygon, row 0 at the bottom."""
    x, y = np.meshgrid(*[(np.arange(80) + 0.5) * CELL] * 2)
    return shapely.contains_xy(shapely.union_all([shapely.Polygon(outline) for outline in outlines]), x, y)


def test_the_polygons_cover_all_cells_but_the_largest_free_area(tmp_path):
    cells = rooms()
    outlines, width, center = floor_map.floor_of(write(tmp_path, cells))
    free = cells == FREE
    free[22:28, 22:28] = False
    solid = np.ones((80, 80), dtype=bool)
    solid[:60] = ~free[::-1]
    assert np.array_equal(covered(outlines), solid)
    assert sum(shapely.Polygon(outline).area for outline in outlines) == pytest.approx(solid.sum() * CELL**2)
    assert (width, center) == (20, (7, 12))


def test_negated_and_probabilistic_maps_have_the_same_floor(tmp_path):
    cells = rooms()
    expected = covered(floor_map.floor_of(write(tmp_path, cells))[0])
    cells[cells == UNKNOWN] = OCCUPIED
    for path in (write(tmp_path, 255 - cells, negate=1), write(tmp_path, cells, mode="scale")):
        assert np.array_equal(covered(floor_map.floor_of(path)[0]), expected)


def test_the_world_of_a_floor_can_be_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(floor_map, "conf_directory", lambda: tmp_path)
    monkeypatch.setattr(sys, "argv", ["floor_map.py", str(write(tmp_path, rooms()))])
    (tmp_path / "world").mkdir()
    floor_map.main()
    assert "prediction.center=[7.0000,12.0000]" in capsys.readouterr().out
    (call,) = read_calls("--config-dir", str(tmp_path), "task=world", "world=my_map", "exp=people")
    solid = covered([obstacle.shape.vertices for obstacle in call.specs["people"].fixed])
    start = sample_world(call.specs["people"], 0)["robot"]["state"]
    assert not solid[int(start[1] / CELL), int(start[0] / CELL)]
    with pytest.raises(SystemExit):
        floor_map.main()
    assert "my_map.yaml exists: rename" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"image": "none.pgm"}, "none.pgm cannot be read as PNG, PGM or BMP"),
        ({"image": "/dev/zero"}, "/dev/zero cannot be read as PNG, PGM or BMP: expected a regular file"),
        ({"image": "drawing.eps"}, "drawing.eps cannot be read as PNG, PGM or BMP"),
        ({"image": "deep.png"}, "it has Pillow's mode I;16, convert it to 8 bits"),
        ({"origin": [0.0, 0.0, 0.1]}, r"expected an origin with heading 0, got 0.1"),
        ({"origin": [0.0, float("nan"), 0.0]}, "origin.1: Input should be a finite number"),
        ({"origin": [1e8, 0.0, 0.0]}, "origin.0: Input should be less than or equal to"),
        ({"free_thresh": 2.0}, "free_thresh: Input should be less than or equal to 1"),
        ({"resolution": 0}, "resolution: Input should be greater than 0"),
        ({"image": "long.png"}, "cells, expected at most 10000 along a side"),
        ({"mode": "raw"}, "mode: Input should be 'trinary' or 'scale'"),
        ({"negate": 1}, "expected a map with free cells, got none"),
        ({"image": "specks.png"}, "expected at most 1000 polygons, got .* or more: remove specks of noise"),
    ],
)
def test_a_map_that_cannot_be_converted_is_refused(tmp_path, keys, message):
    path = write(tmp_path, np.full((10, 10), FREE, dtype=np.uint8), **keys)
    Image.new("L", (10, 10), FREE).save(tmp_path / "drawing.eps")  # Pillow reads it with Ghostscript
    Image.fromarray(np.full((10, 10), 60_000, np.uint16)).save(tmp_path / "deep.png")  # all cells would be white
    Image.new("L", (10_001, 1), FREE).save(tmp_path / "long.png")
    specks = np.random.default_rng(0).random((400, 400)) < 0.05
    Image.fromarray(np.where(specks, OCCUPIED, FREE).astype(np.uint8)).save(tmp_path / "specks.png")
    with pytest.raises(ValueError, match=message):
        floor_map.floor_of(path)
