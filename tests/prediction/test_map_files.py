import numpy as np
import pytest
import yaml
from PIL import Image

from repro.maps.grid import Grid
from repro.prediction.map_files import write_map, write_probabilities
from repro.prediction.stream_map import StreamMap

GRID = Grid(100, 50.0)
ORIGIN = (-3.0, 7.0)


def predicted(free: np.ndarray, unknown: np.ndarray | None = None) -> StreamMap:
    nothing = np.zeros(free.shape, bool)
    unknown = nothing if unknown is None else unknown
    return StreamMap(free, ORIGIN, 0.5, 12.5, unknown, nothing, np.zeros((0, 2)), (22.0, 32.0, 0.0))


def load_as_map_server(path) -> tuple[np.ndarray, dict]:
    """Read a map as loadMapFromFile of nav2_map_server does, in mode raw: -1 to 100, row 0 at the bottom."""
    facts = yaml.safe_load(path.read_text())
    assert facts["mode"] == "raw"
    image = np.asarray(Image.open(path.with_name(facts["image"])), dtype=int)
    return np.where(image <= 100, image, -1)[::-1], facts


def test_map_server_reads_the_map_where_the_log_has_it(tmp_path):
    free = np.ones((100, 100))
    row, column = 10, 70  # from the top left
    free[row, column] = 0
    free[50, 50] = 0.55
    unknown = np.zeros(free.shape, bool)
    unknown[row, column], unknown[20, :30] = True, True
    write_map(tmp_path / "map", predicted(free, unknown))
    cells, facts = load_as_map_server(tmp_path / "map.yaml")
    assert (tmp_path / "map.pgm").read_bytes().startswith(b"P5\n100 100\n255\n")
    (y,), (x,) = np.nonzero(cells == 100)
    left, bottom, _ = facts["origin"]
    corner = (left + x * facts["resolution"], bottom + y * facts["resolution"])
    centers = GRID.centers().reshape(100, 100, 2)
    assert corner == pytest.approx(tuple(centers[row, column] - 0.25 + ORIGIN), abs=1e-4)
    assert cells[49, 50] == 67  # (0.45 - 0.05) / (0.65 - 0.05)
    assert (cells[79, :30] == -1).all()
    assert (cells == -1).sum() == 30
    assert (cells == 0).sum() == 100 * 100 - 2 - 30


def test_probabilities_are_stored_with_their_place_and_time(tmp_path):
    free = np.random.default_rng(0).random((100, 100))
    unknown = free > 0.5
    write_probabilities(tmp_path / "a.npz", predicted(free, unknown))
    with np.load(tmp_path / "a.npz") as content:
        assert content["free"] == pytest.approx(free, abs=1e-6)
        assert np.array_equal(content["unknown"], unknown)
        assert content["origin"].tolist() == [-3, 7]
        assert (float(content["resolution"]), float(content["stamp"])) == (0.5, 12.5)
