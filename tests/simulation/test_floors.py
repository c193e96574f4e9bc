"""Floors from maps of map_server: which cells the polygons cover, where they lie, and what is refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from conftest import ROOT, read_calls
from PIL import Image

from repro.cli import floors
from repro.simulation.floors import read_floor
from repro.simulation.schema import world_errors
from repro.simulation.worlds import sample_world
from repro.world_config import read_world, world_spec

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
CELL = 0.25


def write(directory: Path, cells: np.ndarray, **keys: object) -> Path:
    """Write a map, row 0 at the top."""
    Image.fromarray(cells).save(directory / "map.pgm")
    content = {"image": "map.pgm", "resolution": CELL, "origin": [-3.0, 2.0, 0.0], "negate": 0, "free_thresh": 0.25}
    path = directory / "my map.yaml"
    path.write_text(yaml.safe_dump({**content, "occupied_thresh": 0.65, **keys}))
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
    cells[0, 70] = FREE
    return cells


def covered(obstacles: list[dict], side: int) -> np.ndarray:
    """Return which cells have their center in a polygon, row 0 at the bottom."""
    whole = shapely.union_all([shapely.Polygon(obstacle["shape"]["vertices"]) for obstacle in obstacles])
    x, y = np.meshgrid(*[(np.arange(side) + 0.5) * CELL] * 2)
    return shapely.contains_xy(whole, x, y)


def test_the_polygons_cover_all_cells_but_the_largest_free_area(tmp_path):
    cells = rooms()
    floor = read_floor(write(tmp_path, cells))
    free = cells == FREE
    free[22:28, 22:28] = free[0, 70] = False
    solid = np.ones((80, 80), dtype=bool)
    solid[:60] = ~free[::-1]
    assert np.array_equal(covered(floor.obstacles, 80), solid)
    assert sum(shapely.Polygon(o["shape"]["vertices"]).area for o in floor.obstacles) == pytest.approx(
        solid.sum() * CELL**2
    )
    assert floor.width_m == 20
    assert floor.center == (7, 12)


def test_negated_and_probabilistic_maps_have_the_same_floor(tmp_path):
    cells = rooms()
    expected = read_floor(write(tmp_path, cells))
    assert read_floor(write(tmp_path, cells, free_thresh=0.196)) == expected
    cells[cells == UNKNOWN] = OCCUPIED
    assert read_floor(write(tmp_path, 255 - cells, negate=1)) == expected
    assert read_floor(write(tmp_path, cells, mode="scale")) == expected


@pytest.fixture
def worlds(tmp_path, monkeypatch) -> Path:
    """Return an empty directory of worlds."""
    monkeypatch.setattr(floors, "conf_directory", lambda: tmp_path)
    (tmp_path / "world").mkdir()
    return tmp_path / "world"


def test_the_world_of_a_floor_is_complete(tmp_path, worlds, capsys):
    source = write(tmp_path, rooms())
    floors.write_floor(str(source))
    assert "prediction.center=[7,12]" in capsys.readouterr().out
    (call,) = read_calls("--config-dir", str(tmp_path), "task=world", "world=my_map", "exp=people")
    world = call.world
    assert world_errors(world) == []
    assert world["robot"]["sensors"][0]["range_max"] == 10
    experiment = world["experiments"]["people"]
    assert experiment["fixed"] == read_floor(source).obstacles
    start = sample_world(world_spec(world, "people"), 0)["robot"]["state"]
    assert not covered(experiment["fixed"], 80)[int(start[1] / CELL), int(start[0] / CELL)]
    with pytest.raises(ValueError, match=r"my_map.yaml exists: rename"):
        floors.write_floor(str(source))
    shutil.copy(ROOT / "conf" / "world" / "office.yaml", worlds)
    assert read_world(worlds / "my_map.yaml") == world  # exports and publications read all worlds


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"image": "none.pgm"}, "none.pgm cannot be read as an image"),
        ({"image": "my map.yaml"}, "my map.yaml cannot be read as an image, expected one of PNG, PPM, "),
        ({"image": "a\0b"}, "cannot be read as an image, .*embedded null"),
        ({"image": "drawing.eps"}, "drawing.eps cannot be read as an image"),
        ({"origin": [0.0, 0.0, 0.1]}, r"expected an origin with heading 0, got 0.1"),
        ({"origin": [0.0, float("nan"), 0.0]}, "origin.1: Input should be a finite number"),
        ({"mode": "raw"}, "mode: Input should be 'trinary' or 'scale'"),
        ({"resolution": 0}, "resolution: Input should be greater than 0"),
        ({"negate": 1}, "expected a map with free cells, got none"),
    ],
)
def test_a_map_that_cannot_be_converted_is_refused(tmp_path, keys, message):
    path = write(tmp_path, np.full((10, 10), FREE, dtype=np.uint8), **keys)
    Image.new("L", (10, 10), FREE).save(tmp_path / "drawing.eps")  # Pillow reads it with Ghostscript
    with pytest.raises(ValueError, match=message):
        read_floor(path)


@pytest.mark.parametrize(("name", "mode"), [("map.png", "I;16"), ("map.pgm", "I"), ("map.png", "LA")])
def test_an_image_of_more_than_8_bits_or_with_transparency_is_refused(tmp_path, name, mode):
    path = write(tmp_path, rooms(), image=name)
    image = Image.fromarray(rooms().astype("uint16") * 257)  # Pillow would make all cells from 1 on white
    (Image.fromarray(rooms()).convert("LA") if mode == "LA" else image).save(tmp_path / name)
    with pytest.raises(ValueError, match=f"{name} cannot be read as an image, .*: it has Pillow's mode {mode}, conv"):
        read_floor(path)


def test_a_file_name_stays_in_the_comment(tmp_path, worlds, capsys):
    source = write(tmp_path, rooms()).rename(tmp_path / "a\nrobot: {}\x85\x1b[1m\u2028b.yaml")
    floors.write_floor(str(source))
    (path,) = worlds.iterdir()
    assert path.name == "a_robot_______1m_b.yaml"
    lines = path.read_text().splitlines()
    assert lines[0].startswith("# The floor of a?robot: {}??[1m?b.yaml; its center")
    assert set(yaml.safe_load(path.read_text())) == {"defaults", "world", "fixed"}
    assert "\x1b" not in capsys.readouterr().out
